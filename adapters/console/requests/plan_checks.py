"""HTTP requests for checks of drafts: the rover checks, proves or tries a plan."""

from dataclasses import dataclass
from http import HTTPStatus
from typing import Final

from aiohttp import web

from adapters.console.requests.commanding import Commanding
from adapters.console.requests.drafts import definition_of
from adapters.console.requests.plan_steps import steps_of
from adapters.console.web import body_of, invalid, json_response
from adapters.mrs.spec import (
    CHECK_LIMIT_S,
    MAX_DRAWS,
    PlanCheckLevel,
    PlanFinding,
    PlanTrial,
    PlanVerdict,
)
from executive.commands import PlanDefinition
from executive.plans import PlanRoot, read_plan

MARGIN_S: Final = 60.0
"""Time for the link and for other checks of an asset, s."""


@dataclass(frozen=True, slots=True)
class DraftFinding:
    """A probable fault of a draft, or a note on it.

    Attributes:
        level: error, warning or note.
        line: its line in the XML.
        step: index of the step at this line; None if there is none.
        node: path of its node; empty for the plan as a whole.
    """

    level: str
    line: int
    step: int | None
    node: str
    text: str


@dataclass(frozen=True, slots=True)
class DraftCheck:
    """Result of a check of a draft by the rover.

    Attributes:
        verdict: refused, faults, no fault found, proved or tried.
        refusal: why the rover would refuse it; None if it would not.
        states: number of explored states; None if nothing was explored.
        limits: parts that were not explored exactly.
        findings: in the order of the rover.
        trial: summary of simulated runs; None without them.
    """

    verdict: str
    refusal: str | None
    states: int | None
    limits: tuple[str, ...]
    findings: tuple[DraftFinding, ...]
    trial: PlanTrial | None


class PlanCheckRequests:
    """Serves these requests.

    Args:
        commanding: access to assets.
    """

    def __init__(self, commanding: Commanding) -> None:
        self._commanding = commanding

    def routes(self) -> list[web.RouteDef]:
        """Return the routes."""
        return [web.post("/api/plans/{asset}/check", self._check)]

    async def _check(self, request: web.Request) -> web.Response:
        asset, body = request.match_info["asset"], await body_of(request)
        names = {each.name.lower(): each for each in PlanCheckLevel}
        if body.get("level") not in names:
            raise invalid("level", f"one of {', '.join(names)} is needed")
        level, draws = names[body["level"]], body.get("draws")
        is_count = isinstance(draws, int) and 1 <= draws <= MAX_DRAWS
        if draws is not None and not (is_count and level is PlanCheckLevel.TRY):
            raise invalid("draws", f"1 to {MAX_DRAWS} runs, with try only")
        definition = definition_of(body)
        found = await self._commanding.query(
            asset,
            lambda client: client.check_plan(definition, level, draws),
            HTTPStatus.UNPROCESSABLE_ENTITY,
            CHECK_LIMIT_S[level] + MARGIN_S,
        )
        lines = _lines_of(definition)
        is_limited = found.verdict is PlanVerdict.PROVED and bool(found.limits)
        verdict = PlanVerdict.NO_FAULT_FOUND if is_limited else found.verdict
        return json_response(
            DraftCheck(
                verdict.name.lower().replace("_", " "),
                found.refusal,
                found.states,
                found.limits,
                tuple(_finding(each, lines) for each in found.findings),
                found.trial,
            )
        )


def _lines_of(definition: PlanDefinition) -> tuple[int, ...]:
    """Return the lines of the steps of a plan; none if it is no list of steps."""
    root = read_plan(definition)
    found = steps_of(root, definition.content) if isinstance(root, PlanRoot) else None
    return tuple(each.line for each in found) if isinstance(found, tuple) else ()


def _finding(finding: PlanFinding, lines: tuple[int, ...]) -> DraftFinding:
    step = lines.index(finding.line) if finding.line in lines else None
    return DraftFinding(finding.level.name.lower(), finding.line, step, finding.node, finding.text)
