"""Plans in which the product differs from 4.10 on purpose: each fault of 4.10 by itself."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Final

from tests.support.random_plans import RandomPlan, plan_text


@dataclass(frozen=True, slots=True)
class Difference:
    """One deliberate difference.

    Attributes:
        body: the root node of the plan.
        why: what 4.10 does, and the product instead.
        telemetry: values by tick.
        abort: tick at which the plan is aborted, instead of a tick of its tree; -1 for none.
    """

    body: str
    why: str
    telemetry: Mapping[str, list[float]] = field(default_factory=dict)
    abort: int = -1

    @property
    def plan(self) -> RandomPlan:
        """The plan."""
        return RandomPlan(plan_text(self.body), dict(self.telemetry), self.abort)


def _command(script: str, more: str = "") -> str:
    return f'<takePicture name="{script}" deadline_s="1000"{more}/>'


_SKIPPED: Final = '<Near name="c S" x="0" y="0" within="1" _skipIf="1 == 1"/>'
_HALTED: Final = ' _onHalted="x += 1.0"'
_YIELDING: Final = (
    "<ForceSuccess><AsyncSequence><AlwaysSuccess/><AlwaysSuccess/></AsyncSequence></ForceSuccess>"
)

DIFFERENCES_OF_4_10: Final = MappingProxyType(
    {
        "failed condition of IfThenElse": Difference(
            '<RetryUntilSuccessful num_attempts="3"><IfThenElse>'
            f"{_command('a RF RS')}{_command('b S')}</IfThenElse></RetryUntilSuccessful>",
            "it stays FAILURE there, and its action never starts again; here it is reset",
        ),
        "skipped condition of IfThenElse": Difference(
            f"<Fallback><IfThenElse>{_SKIPPED}{_command('a S')}</IfThenElse>{_command('b RS')}"
            "</Fallback>",
            "an exception; here the IfThenElse is skipped",
        ),
        "skipped condition of WhileDoElse": Difference(
            f"<Fallback><WhileDoElse>{_SKIPPED}{_command('a S')}</WhileDoElse>{_command('b RS')}"
            "</Fallback>",
            "an exception; here the WhileDoElse is skipped",
        ),
        "halted Precondition": Difference(
            '<Repeat num_cycles="2"><Sequence><ForceSuccess><ReactiveSequence>'
            '<ScriptCondition code="@LINK_UP == 1"/><Precondition if="@BATERY_VOLTAGE &gt; 2">'
            f"{_command('a R')}</Precondition></ReactiveSequence></ForceSuccess>"
            f"{_command('b RS')}</Sequence></Repeat>",
            "it is not evaluated again after a halt; here it is",
            {"LINK_UP": [1, 0, 1], "BATERY_VOLTAGE": [3, 3, 0]},
        ),
        "Timeout that is not ticked": Difference(
            f"<WhileDoElse><Sequence>{_command('a S RRRS S')}</Sequence>"
            f'<Timeout msec="150">{_command("b R")}</Timeout></WhileDoElse>',
            "a thread halts its child between ticks; here the Timeout halts it in its own tick",
        ),
        "SetBlackboard of a text": Difference(
            """<Sequence><Script code="s := 'a'"/><SetBlackboard output_key="s" value="b"/>"""
            f"{_command('a RS')}</Sequence>",
            "a variable that a script created loses its value; here it is written",
        ),
        "abort": Difference(
            '<Sequence><Script code="x := 0.0"/><Parallel>'
            f"{_command('a S', _HALTED)}{_command('b R', _HALTED)}"
            f"</Parallel>{_command('c S', _HALTED)}</Sequence>",
            "haltTree runs _onHalted of each node; here only of nodes that are RUNNING",
            abort=1,
        ),
        "tick without end": Difference(
            f"<ReactiveSequence>{_YIELDING}{_YIELDING}{_command('a S')}</ReactiveSequence>",
            "tickOnce never returns; here the tick ends after 50 executions of the root",
        ),
        "Sleep begun again": Difference(
            '<Repeat num_cycles="2"><Sequence><ForceSuccess><ReactiveSequence>'
            '<ScriptCondition code="@LINK_UP == 1"/><Sleep msec="300"/></ReactiveSequence>'
            f"</ForceSuccess>{_command('a RS')}</Sequence></Repeat>",
            "the thread of its cancelled timer can end it at once; here it takes its time",
            {"LINK_UP": [1, 0, 1]},
        ),
        "exception in a condition": Difference(
            '<Fallback><ScriptCondition code="w &gt; 1"/>'
            f'<Sequence><Script code="w := 2.0"/>{_command("a RS")}</Sequence></Fallback>',
            "the whole tick ends by an exception; here an unknown value fails its node",
        ),
        "division by zero": Difference(
            f'<Fallback><Script code="x := 1.0 / 0.0"/>{_command("a RS")}</Fallback>',
            "infinity; here the script, and with it the plan, fails",
        ),
    }
)
