"""HTTP requests for drafts of plans: written, checked and previewed; nothing is sent to the rover.

A draft is a list of steps or the XML of a plan; the answer has both. The check is that of
`rover plan check`, the preview is computed aboard.
"""

import asyncio
import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any, Final

from aiohttp import web

from adapters.console.requests.commanding import Commanding
from adapters.console.requests.objects import plan_of
from adapters.console.requests.plan_steps import FIRST_LINE as FIRST_STEP_LINE
from adapters.console.requests.plan_steps import DraftStep, WrittenStep, sequence_xml, steps_of
from adapters.console.web import RequestError, body_of, invalid, is_number, json_response, text_of
from adapters.mrs.spec import PlanPreview
from executive.commands import PlanDefinition, Waypoint
from executive.commands.intake import source_of
from executive.plans import (
    CellReference,
    PlanNode,
    PlanRoot,
    Script,
    check_bounds,
    nodes,
    read_plan,
)
from executive.settings import config_folder
from executive.values.plan_nodes import PlanNodeReport
from executive.values.reasons import Refusal

MAX_STEPS: Final = 500
_COMMENT: Final = re.compile(r"<!--\s*(.*?)\s*(?:-->|\n)")


@dataclass(frozen=True, slots=True)
class OutlineNode:
    """A node of a plan.

    Attributes:
        path: names from the root, joined by slashes, as in the node table of a plan.
        depth: 0 for the root of the main tree.
        text: its ports and conditions.
        line: its line in the XML.
    """

    path: str
    name: str
    kind: str
    depth: int
    text: str
    line: int


@dataclass(frozen=True, slots=True)
class PlanNodeEntry(OutlineNode):
    """A node of a plan aboard, with its progress; `text` is why it failed last.

    Attributes:
        status: idle, running, success or failure.
        result: result of its last end; None before.
        since: when it began, ended or was halted last.
        tries: how often it began.
        code: number of the reason of its last failure, if it was that of a command.
        unknown: name of the value that it needs and that is not known; empty for none.
        decision: its last choice; empty without one.
        next: end of its wait, deadline or window.
        has_question: whether its question is open.
        command: its last command, as SOURCE:NUMBER.
    """

    status: str
    result: str | None
    since: float | None
    tries: int
    code: int | None
    unknown: str
    decision: str
    next: float | None
    has_question: bool
    command: str | None


@dataclass(frozen=True, slots=True)
class DraftProblem:
    """The first reason to refuse a draft.

    Attributes:
        text: human-readable reason.
        code, reason: number and name of the reason.
        line: line of the XML; None if the reason concerns no line.
        step: index of the step at this line; None if there is none.
    """

    text: str
    code: int
    reason: str
    line: int | None
    step: int | None


@dataclass(frozen=True, slots=True)
class PlanDraft:
    """A draft with its check and its preview.

    Attributes:
        plan: id of the plan.
        xml: its text.
        steps: its steps, also if bounds are exceeded; None if it is not valid or no sequence.
        not_steps: why a valid plan has no list of steps.
        outline: the nodes of such a plan, in depth-first order.
        problem: why it would be refused; None for a valid plan.
        preview: its preview by the rover, if there is no problem.
        not_previewed: why there is no preview that was requested.
    """

    plan: str
    xml: str
    steps: tuple[DraftStep, ...] | None
    not_steps: str | None
    outline: tuple[OutlineNode, ...]
    problem: DraftProblem | None
    preview: PlanPreview | None
    not_previewed: str | None


@dataclass(frozen=True, slots=True)
class PlanTemplate:
    """A plan of the configuration.

    Attributes:
        about: its first comment, one line.
    """

    name: str
    about: str
    xml: str


class DraftRequests:
    """Serves these requests.

    Args:
        commanding: access to assets.
    """

    def __init__(self, commanding: Commanding) -> None:
        self._commanding = commanding
        self._turns: defaultdict[str, asyncio.Lock] = defaultdict(asyncio.Lock)

    def routes(self) -> list[web.RouteDef]:
        """Return the routes."""
        return [
            web.get("/api/plans/templates", self._templates),
            web.post("/api/plans/{asset}/draft", self._draft),
            web.get("/api/plans/{asset}/{plan}/nodes", self._nodes),
        ]

    async def _templates(self, _: web.Request) -> web.Response:
        return json_response({"templates": templates(config_folder() / "plans")})

    async def _nodes(self, request: web.Request) -> web.Response:
        asset, plan_id = request.match_info["asset"], request.match_info["plan"]
        found = await self._commanding.query(asset, lambda client: client.get_plan_nodes(plan_id))
        return json_response({"nodes": node_entries(plan_id, found)})

    async def _draft(self, request: web.Request) -> web.Response:
        asset, body = request.match_info["asset"], await body_of(request)
        definition = definition_of(body)
        settings, root = self._commanding.settings(asset), read_plan(definition)
        refusal: Refusal | None
        steps: tuple[DraftStep, ...] | None = None
        outline: tuple[OutlineNode, ...] = ()
        not_steps = None
        if isinstance(root, Refusal):
            refusal = root
        else:
            refusal = None if settings is None else check_bounds(root, settings)
            found = steps_of(root, definition.content)
            if isinstance(found, tuple):
                steps = found
            else:
                outline, not_steps = outline_of(root), _objection(found)
        problem = None if refusal is None else _problem(refusal, steps, "xml" not in body)
        preview, not_previewed = None, None
        if problem is None and body.get("preview", True):
            preview, not_previewed = await self._preview(asset, definition)
        plan_id, xml = definition.plan_id, definition.content.decode()
        return json_response(
            PlanDraft(plan_id, xml, steps, not_steps, outline, problem, preview, not_previewed)
        )

    async def _preview(
        self, asset: str, plan: PlanDefinition
    ) -> tuple[PlanPreview | None, str | None]:
        try:
            async with self._turns[asset]:  # an asset computes few previews at the same time
                return await self._commanding.preview_plan(asset, plan), None
        except RequestError as error:
            return None, error.problem.error


def _objection(node: PlanNode) -> str:
    """Return why a plan with this node has no list of steps."""
    if isinstance(node, PlanRoot):
        return "it continues after a restart (after_restart), which only its XML has"
    return f"line {node.location.line}: {node.location.name} is no step of a single sequence"


def outline_of(root: PlanNode) -> tuple[OutlineNode, ...]:
    """Return the nodes of a plan below its root."""
    return tuple(
        OutlineNode(at.path, at.name, node.kind.name, at.path.count("/") - 1, _about(node), at.line)
        for node in nodes(root)
        if (at := node.location).number != root.location.number
    )


def node_entries(plan_id: str, found: Sequence[PlanNodeReport]) -> list[PlanNodeEntry]:
    """Return the nodes of a plan aboard below its root, which an orbiter does not know."""
    return [_node_entry(each) for each in found if each.path != source_of(plan_id)]


def _node_entry(node: PlanNodeReport) -> PlanNodeEntry:
    return PlanNodeEntry(
        path=node.path,
        name=node.path.rpartition("/")[2],
        kind=node.kind,
        depth=node.path.count("/") - 1,
        text=node.text,
        line=node.line,
        status=node.status.name.lower(),
        result=None if node.result is None else node.result.name.lower(),
        since=node.since_utc_s,
        tries=node.tries,
        code=None if node.reason is None else node.reason.value,
        unknown=node.unknown,
        decision=node.decision,
        next=node.next_utc_s,
        has_question=node.question is not None,
        command=None if node.command is None else str(node.command),
    )


def _about(node: PlanNode) -> str:
    given = {**node.ports, **node.conditions}
    return ", ".join(f"{name} {_text(value)}" for name, value in given.items())


def _text(value: object) -> str:
    match value:
        case Script():
            return value.text
        case CellReference():
            return f"{{{value.name}}}"
        case tuple():
            return ";".join(map(_text, value))
        case Waypoint():
            parts = (value.x_m, value.y_m, value.heading_rad)
            return ",".join(f"{each:g}" for each in parts if each is not None)
        case float():
            return f"{value:g}"
        case Enum():
            return str(value.value)
        case _:
            return str(value)


def templates(folder: Path) -> list[PlanTemplate]:
    """Return the plans of a folder and of those in it, by path."""
    found = []
    for path in sorted(folder.rglob("*.xml")):
        xml = path.read_text(encoding="utf-8", errors="replace")
        comment = _COMMENT.search(xml)
        found.append(PlanTemplate(path.stem, "" if comment is None else comment[1], xml))
    return found


def definition_of(body: dict[str, Any]) -> PlanDefinition:
    """Return the plan of a body with its XML or its steps.

    Raises:
        RequestError: a field is invalid.
    """
    plan_id, xml = text_of(body, "plan"), body.get("xml")
    if "xml" not in body:
        try:
            xml = sequence_xml(_written(body.get("steps")))
        except ValueError as error:
            raise invalid("steps", str(error)) from error
    given = {"plan_id": plan_id, "content": xml, "arguments": body.get("arguments", {})}
    return plan_of(given)


def _written(given: object) -> list[WrittenStep]:
    if not isinstance(given, list) or len(given) > MAX_STEPS:
        raise invalid("steps", f"a list of at most {MAX_STEPS} steps, or xml, is needed")
    return [_written_step(f"steps[{index}]", each) for index, each in enumerate(given)]


def _written_step(field: str, given: object) -> WrittenStep:
    if not isinstance(given, Mapping) or not isinstance(given.get("args", {}), Mapping):
        text = "an object {operation, args, name?, deadline?, conditions?} is needed"
        raise invalid(field, text)
    name, deadline_s = given.get("name") or None, given.get("deadline")
    if not isinstance(given.get("operation"), str) or not isinstance(name, str | None):
        raise invalid(field, "operation, and name if given, are texts")
    if deadline_s is not None and not is_number(deadline_s):
        raise invalid(field, "deadline: seconds are needed")
    conditions = given.get("conditions", {})
    if not isinstance(conditions, Mapping) or not all(map(_is_text, conditions.values())):
        raise invalid(field, "conditions: an object of texts is needed")
    return WrittenStep(given["operation"], given.get("args", {}), name, deadline_s, conditions)


def _is_text(value: object) -> bool:
    return isinstance(value, str)


def _problem(
    refusal: Refusal, steps: tuple[DraftStep, ...] | None, is_written: bool
) -> DraftProblem:
    """Return a refusal as a problem of the step at its line."""
    lines = [int(figure.value) for figure in refusal.figures if figure.name == "line"]
    line = lines[0] if lines else None
    index = next((i for i, each in enumerate(steps or ()) if each.line == line), None)
    if is_written and steps is None and line is not None and line >= FIRST_STEP_LINE:
        index = line - FIRST_STEP_LINE
    text = refusal.text.removeprefix(f"line {line}: ")
    return DraftProblem(text, refusal.reason.value, refusal.reason.name, line, index)
