"""What a file asks of the rover: an operation and its arguments into a request."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from executive.commands import (
    PlanArgument,
    PlanDefinition,
    Request,
    SubmitPlan,
    declaration_of,
    declared,
)
from executive.plans import FORMAT
from executive.settings import config_folder
from sim.scenario.strict import FormatError, StrictReader

OPERATIONS: Final = {each.name: each for each in declared()}
SUFFIX: Final = ".xml"


def operation_of(request: Request) -> str:
    """Return the name of the operation that carries a request."""
    return declaration_of(type(request)).name


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanFile:
    """A plan to submit.

    Attributes:
        plan: a name in config/plans, or an XML file beside the scenario.
        id: under which it is submitted; None is the file's name.
    """

    plan: str
    id: str | None = None
    arguments: tuple[PlanArgument, ...] = ()


def read_request(raw: Any, folder: Path, reader: StrictReader) -> Request:
    """Return what a file asks of the rover.

    Raises:
        FormatError: there is no such operation, or its arguments do not fit.
    """
    alone = isinstance(raw, dict) and len(raw) == 1
    name, arguments = next(iter(raw.items())) if alone else (raw, {})
    declaration = OPERATIONS.get(name) if isinstance(name, str) else None
    if declaration is None:
        raise FormatError("", f"{name!r} is no operation; known are {', '.join(OPERATIONS)}")
    if declaration.kind is SubmitPlan:
        return SubmitPlan(_plan(reader.read(arguments, PlanFile, name), f"{name}.plan", folder))
    whole = declaration.composite
    request: Request = (
        reader.read(arguments, declaration.kind, name)
        if whole is None
        else declaration.kind(reader.read(arguments, whole, name))
    )
    return request


def _plan(said: PlanFile, path: str, folder: Path) -> PlanDefinition:
    beside = said.plan.endswith(SUFFIX)
    file = folder / said.plan if beside else config_folder() / "plans" / f"{said.plan}{SUFFIX}"
    try:
        content = file.read_bytes()
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) else error
        raise FormatError(path, f"{said.plan!r} cannot be read ({why})") from error
    return PlanDefinition(said.id or file.stem, file.name, FORMAT, content, said.arguments)
