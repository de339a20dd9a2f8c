"""`CommandLifecycle`: the stages of a command as a table of edges; the results of `submit`.

RECEIVED, ACCEPTED and EXECUTED are the thesis's three (5.1.2); the others are refusals, failures
and external endings. Every life cycle ends in exactly one terminal stage.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Final, Generic, TypeVar

from transitions import Machine

from executive.commands.catalogue import Command
from executive.values.reasons import Figure, Refusal
from executive.values.reports import Report, Stage

E = TypeVar("E", bound=Enum)
S = TypeVar("S", bound=Enum)


class Event(Enum):
    """Events of a command's life cycle."""

    ACCEPT = "accept"
    REJECT = "reject"
    START = "start"
    ADVANCE = "advance"
    EXECUTE = "execute"
    FAIL = "fail"
    CANCEL = "cancel"
    EXPIRE = "expire"


@dataclass(frozen=True, slots=True)
class Edge(Generic[E, S]):
    """One permitted change of state."""

    event: E
    source: S
    target: S


EDGES: Final = (
    Edge(Event.ACCEPT, Stage.RECEIVED, Stage.ACCEPTED),
    Edge(Event.REJECT, Stage.RECEIVED, Stage.REJECTED),
    Edge(Event.START, Stage.ACCEPTED, Stage.STARTED),
    Edge(Event.EXPIRE, Stage.ACCEPTED, Stage.EXPIRED),
    Edge(Event.CANCEL, Stage.ACCEPTED, Stage.CANCELLED),
    Edge(Event.ADVANCE, Stage.STARTED, Stage.PROGRESS),
    Edge(Event.EXECUTE, Stage.STARTED, Stage.EXECUTED),
    Edge(Event.FAIL, Stage.STARTED, Stage.FAILED),
    Edge(Event.CANCEL, Stage.STARTED, Stage.CANCELLED),
    Edge(Event.ADVANCE, Stage.PROGRESS, Stage.PROGRESS),
    Edge(Event.EXECUTE, Stage.PROGRESS, Stage.EXECUTED),
    Edge(Event.FAIL, Stage.PROGRESS, Stage.FAILED),
    Edge(Event.CANCEL, Stage.PROGRESS, Stage.CANCELLED),
)


def make_machine(edges: Sequence[Edge[E, S]], attribute: str) -> Machine:
    """Return the state machine of a table of edges; its initial state is the first edge's source.

    It serves any number of models: its events are triggered with a model, and change its attribute.
    """
    return Machine(
        model=None,
        states=type(edges[0].source),
        initial=edges[0].source,
        transitions=[
            {"trigger": edge.event.value, "source": edge.source, "dest": edge.target}
            for edge in edges
        ],
        auto_transitions=False,
        model_attribute=attribute,
    )


_MACHINE: Final = make_machine(EDGES, "stage")


@dataclass(frozen=True, slots=True)
class StageDetails:
    """Details of the report on a change of stage."""

    text: str = ""
    refusal: Refusal | None = None
    figures: tuple[Figure, ...] = ()
    step: int | None = None
    step_count: int | None = None


Notify = Callable[[Command, Stage, StageDetails], None]


class CommandLifecycle:
    """Life cycle of one command. Each method fires one event and notifies once.

    Args:
        notify: called with every stage reached.
        stage: the stage that another process left; without one, RECEIVED is notified.

    Attributes:
        refusal: the reason if it ended without success.

    Raises:
        transitions.MachineError: from any method, if its event has no edge from this stage.
    """

    def __init__(self, command: Command, notify: Notify, stage: Stage | None = None) -> None:
        self.command = command
        self.stage = stage or Stage.RECEIVED
        self.refusal: Refusal | None = None
        self._notify = notify
        if stage is None:
            notify(command, Stage.RECEIVED, StageDetails())

    def accept(self) -> None:
        """Report that checks passed; the command will be executed."""
        self._fire(Event.ACCEPT, StageDetails())

    def reject(self, refusal: Refusal) -> None:
        """Report that checks failed; the command will not be executed."""
        self._fire(Event.REJECT, StageDetails(refusal=refusal))

    def start(self) -> None:
        """Report that execution has started."""
        self._fire(Event.START, StageDetails())

    def advance(self, step: int, step_count: int, text: str) -> None:
        """Report that a step of several was reached."""
        self._fire(Event.ADVANCE, StageDetails(text=text, step=step, step_count=step_count))

    def execute(self, text: str = "", figures: tuple[Figure, ...] = ()) -> None:
        """Report successful completion."""
        self._fire(Event.EXECUTE, StageDetails(text=text, figures=figures))

    def fail(self, refusal: Refusal, figures: tuple[Figure, ...] = ()) -> None:
        """Report that execution failed, with the figures of its motion."""
        self._fire(Event.FAIL, StageDetails(refusal=refusal, figures=figures))

    def cancel(self, refusal: Refusal) -> None:
        """Report that a later command ended it."""
        self._fire(Event.CANCEL, StageDetails(refusal=refusal))

    def expire(self, refusal: Refusal) -> None:
        """Report that its lifetime expired before it could start."""
        self._fire(Event.EXPIRE, StageDetails(refusal=refusal))

    def _fire(self, event: Event, note: StageDetails) -> None:
        self.refusal = note.refusal
        _MACHINE.events[event.value].trigger(self)
        self._notify(self.command, self.stage, note)


def terminal_states(edges: Sequence[Edge[E, S]]) -> tuple[S, ...]:
    """Return the states without outgoing edges."""
    sources = {edge.source for edge in edges}
    return tuple(state for state in type(edges[0].source) if state not in sources)


@dataclass(frozen=True, slots=True)
class Accepted:
    """The command was accepted and committed; its life cycle reports follow."""

    lifecycle: CommandLifecycle


@dataclass(frozen=True, slots=True)
class Rejected:
    """The command will not be executed."""

    refusal: Refusal


@dataclass(frozen=True, slots=True)
class Duplicate:
    """The same command was submitted before; its last report is sent again.

    It is not executed again, except a stop, which always acts.
    """

    last_report: Report


SubmitResult = Accepted | Rejected | Duplicate
