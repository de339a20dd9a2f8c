"""HTTP requests for drafts of plans: written, checked and previewed; nothing is sent to the rover.

A draft is a list of steps or the XML of a plan; the answer has both. The check is that of
`rover plan check`, the preview is computed aboard.
"""

import asyncio
import re
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from aiohttp import web

from adapters.console.requests.commanding import Commanding
from adapters.console.requests.objects import plan_of
from adapters.console.web import RequestError, body_of, invalid, is_number, json_response, text_of
from adapters.mrs.spec import PlanPreview
from executive.commands import PlanDefinition, argument_values, declaration_of
from executive.plans import FIRST_LINE as FIRST_STEP_LINE
from executive.plans import (
    PlanNode,
    PlanStep,
    WrittenStep,
    check_bounds,
    read_plan,
    sequence_xml,
    steps_of,
)
from executive.settings import config_folder
from executive.values.reasons import Refusal

MAX_STEPS: Final = 500
_COMMENT: Final = re.compile(r"<!--\s*(.*?)\s*(?:-->|\n)")


@dataclass(frozen=True, slots=True)
class DraftStep:
    """A step of a draft.

    Attributes:
        node: path of its leaf, as in `PlanProgress` and in previews.
        name, operation: name of its node, and of its leaf.
        args: arguments by name, in SI units and radians, as in `CommandStatus`.
        deadline: timeout, s; None if the plan sets another limit.
        line: its line in the XML.
    """

    node: str
    name: str
    operation: str
    args: dict[str, Any]
    deadline: float | None
    line: int


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
        problem: why it would be refused; None for a valid plan.
        preview: its preview by the rover, if there is no problem.
        not_previewed: why there is no preview that was requested.
    """

    plan: str
    xml: str
    steps: tuple[DraftStep, ...] | None
    not_steps: str | None
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
        ]

    async def _templates(self, _: web.Request) -> web.Response:
        return json_response({"templates": templates(config_folder() / "plans")})

    async def _draft(self, request: web.Request) -> web.Response:
        asset, body = request.match_info["asset"], await body_of(request)
        definition = _definition_of(body)
        settings, root = self._commanding.settings(asset), read_plan(definition)
        refusal: Refusal | None
        if isinstance(root, Refusal):
            refusal, steps, not_steps = root, None, None
        else:
            refusal = None if settings is None else check_bounds(root, settings)
            steps, not_steps = _steps(root)
        problem = None if refusal is None else _problem(refusal, steps, "xml" not in body)
        preview, not_previewed = None, None
        if problem is None and body.get("preview", True):
            preview, not_previewed = await self._preview(asset, definition)
        plan_id, xml = definition.plan_id, definition.content.decode()
        return json_response(
            PlanDraft(plan_id, xml, steps, not_steps, problem, preview, not_previewed)
        )

    async def _preview(
        self, asset: str, plan: PlanDefinition
    ) -> tuple[PlanPreview | None, str | None]:
        try:
            async with self._turns[asset]:  # an asset computes few previews at the same time
                return await self._commanding.preview_plan(asset, plan), None
        except RequestError as error:
            return None, error.problem.error


def templates(folder: Path) -> list[PlanTemplate]:
    """Return the plans of a folder, by name."""
    found = []
    for path in sorted(folder.glob("*.xml")):
        xml = path.read_text(encoding="utf-8", errors="replace")
        comment = _COMMENT.search(xml)
        found.append(PlanTemplate(path.stem, "" if comment is None else comment[1], xml))
    return found


def _definition_of(body: dict[str, Any]) -> PlanDefinition:
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
        raise invalid(field, "an object {operation, args, name?, deadline?} is needed")
    name, deadline_s = given.get("name") or None, given.get("deadline")
    if not isinstance(given.get("operation"), str) or not isinstance(name, str | None):
        raise invalid(field, "operation, and name if given, are texts")
    if deadline_s is not None and not is_number(deadline_s):
        raise invalid(field, "deadline: seconds are needed")
    return WrittenStep(given["operation"], given.get("args", {}), name, deadline_s)


def _steps(root: PlanNode) -> tuple[tuple[DraftStep, ...] | None, str | None]:
    """Return the steps of a plan, or the reason why it has no list of steps."""
    found = steps_of(root)
    if isinstance(found, tuple):
        return tuple(map(_step, found)), None
    location = found.location
    return None, f"line {location.line}: {location.name} is no step of a single sequence"


def _step(step: PlanStep) -> DraftStep:
    location, request = step.location, step.request
    assert request is not None  # a plan with other steps has no list of steps
    operation = declaration_of(type(request)).name
    args = argument_values(request)
    return DraftStep(location.path, location.name, operation, args, step.deadline_s, location.line)


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
