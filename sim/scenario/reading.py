"""A scenario file into a `Scenario`, or one error that names the file and the key.

Labels must be known and times reached; not each mode of playing has all that a file can say.
"""

import re
from collections.abc import Iterator, Sequence
from contextvars import ContextVar
from dataclasses import dataclass, field, fields, make_dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

from executive.commands import (
    CommandDeclaration,
    PlanArgument,
    PlanDefinition,
    Request,
    SubmitPlan,
    declared,
)
from executive.commands.intake import SOURCE_PREFIX
from executive.plans import FORMAT
from executive.settings import (
    FormatError,
    LocomotionKind,
    Settings,
    SettingsError,
    StrictReader,
    config_folder,
    load_settings,
    load_yaml,
    named_file,
    settings_reader,
    shown,
)
from sim.rover import World, load_world
from sim.rover.faults import (
    FaultTarget,
    LinkLost,
    SimulatedFault,
    lacking,
    parts_of,
    read_fault,
    read_kind,
)
from sim.rover.jackal import OdometrySettings
from sim.rover.lockstep import STEP_S
from sim.scenario import expect_commands as of_commands
from sim.scenario import expect_rover as of_rover
from sim.scenario import model
from sim.scenario.changes import Override, changed
from sim.scenario.model import (
    Entry,
    Expectation,
    Fetch,
    QueryParameters,
    Repeat,
    RunMode,
    Scenario,
    Send,
)
from sim.scenario.record import Scheduled, ScheduledInterval, StageTime

SUFFIXES: Final = (".yaml", ".yml")
OPERATIONS: Final = {each.name: each for each in declared()}
LINKS: Final = tuple(each.link for each in (RunMode.DIRECT, RunMode.RELAY))
"""Those of live runs."""
_LARGEST_PX: Final = (1280, 960)
_FOLDER: Final[ContextVar[Path]] = ContextVar("folder")
"""Of the file that is read: plans are found beside it."""


def scenario_folder() -> Path:
    """Return where the scenarios lie that have a name."""
    return config_folder() / "scenarios"


def scenario_path(name: str) -> Path:
    """Return the file of a scenario, which is a path or the name of one in config/scenarios.

    Raises:
        SettingsError: there is none of that name.
    """
    return path_of("scenario", name, scenario_folder())


def path_of(kind: str, name: str, folder: Path) -> Path:
    """Return a file that is given by its path, or by its name in a folder.

    Raises:
        SettingsError: there is none of that name.
    """
    path = Path(name)
    if path.name == name and path.suffix not in SUFFIXES:
        return named_file(kind, name, folder)
    return path


def load_scenario(
    name: str, mode: RunMode | None = None, changes: Sequence[Override] = ()
) -> Scenario:
    """Read a scenario.

    Args:
        name: a path, or the name of a file in config/scenarios.
        mode: it is to be played, which not every scenario can be each way; None for not at all.
        changes: to what the file says, made one after the other before it is checked.

    Raises:
        SettingsError: there is no such scenario, or it says what no scenario can say; where it is
            a change that says so, the text names it.
    """
    path = scenario_path(name)
    raw = load_yaml(path)
    try:
        return _checked(raw, path.parent, mode, changes)
    except FormatError as error:
        blamed = _blamed(raw, path.parent, mode, changes)
        said = f"changed by {blamed}: " if blamed and "changed by" not in str(error) else ""
        raise SettingsError(f"{path}: {said}{error}") from error


def _checked(
    raw: object, folder: Path, mode: RunMode | None, changes: Sequence[Override]
) -> Scenario:
    scenario = _scenario(raw, folder, changes)
    check(scenario)
    if mode is not None:
        check_play_mode(scenario, mode)
    return scenario


def _blamed(
    raw: object, folder: Path, mode: RunMode | None, changes: Sequence[Override]
) -> Override | None:
    """Return the last change before which the data fitted; None if it never did."""
    for count in range(len(changes) - 1, -1, -1):
        try:
            _checked(raw, folder, mode, changes[:count])
        except FormatError:
            continue
        return changes[count]
    return None


def _scenario(raw: object, folder: Path, changes: Sequence[Override]) -> Scenario:
    if not isinstance(raw, dict):
        raise FormatError("", "a scenario is keys and values, such as title, timeline, expect")
    reader = _reader()
    _FOLDER.set(folder)
    raw = changed(raw, changes, lambda name: reader.plain(_world(name, folder, reader)))
    settings = _settings(raw.get("asset", "jackal"), folder)
    filled = {
        **raw,
        "settings": reader.overlay(settings, raw.get("settings", {}), "settings"),
        "world": _world(raw.get("world", "flat"), folder, reader),
    }
    return reader.read(filled, Scenario)


@cache
def _reader() -> StrictReader:
    """Return the reader of scenarios; to make one costs more than to read a hundred files."""
    reader = settings_reader(
        {
            StageTime: lambda raw: StageTime.parse(_text(raw, "")),
            Request: lambda raw: read_request(raw, reader),
            SimulatedFault: read_fault,
            type[SimulatedFault]: lambda raw: read_kind(raw).kind,
        }
    )
    return reader


def _settings(asset: object, folder: Path) -> Settings:
    name = _name(asset, "asset")
    try:
        return load_settings(str(folder / name) if name.endswith(SUFFIXES) else name)
    except SettingsError as error:
        raise FormatError("asset", str(error)) from error


def _world(raw: object, folder: Path, reader: StrictReader) -> World:
    if not isinstance(raw, str):
        return reader.read(raw, World, "world")
    name = _name(raw, "world")
    try:
        if name.endswith(SUFFIXES):
            return load_world(folder / name)
        return load_world(named_file("world", name, config_folder() / "worlds"))
    except SettingsError as error:
        raise FormatError("world", " ".join(str(error).split())) from error


def _name(raw: object, path: str) -> str:
    name = _text(raw, path)
    if not name.isprintable():
        raise FormatError(path, f"{name!r} is no name")
    return name


def _text(raw: object, path: str) -> str:
    if not isinstance(raw, str):
        raise FormatError(path, f"expected a text, got {shown(raw)}")
    return raw


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


def read_request(raw: Any, reader: StrictReader) -> Request:
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
        return SubmitPlan(_plan(reader.read(arguments, PlanFile, name), f"{name}.plan"))
    made = reader.read(arguments, _written(declaration), name)
    request: Request = declaration.make(
        *(getattr(made, each.field) for each in declaration.written)
    )
    return request


@cache
def _written(declaration: CommandDeclaration) -> Any:
    """Return the dataclass of what a file says of a request: the parts of its composite, if any."""
    if declaration.composite is None:
        return declaration.kind
    _, *others = fields(declaration.kind)
    said = [
        (each.name, each.type, field(default=each.default))
        for each in (*fields(declaration.composite), *others)
    ]
    return make_dataclass(declaration.kind.__name__, said)


def _plan(said: PlanFile, path: str) -> PlanDefinition:
    named = config_folder() / "plans" / f"{said.plan}.xml"
    file = _FOLDER.get() / said.plan if said.plan.endswith(".xml") else named
    try:
        content = file.read_bytes()
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) else error
        raise FormatError(path, f"{said.plan!r} cannot be read ({why})") from error
    return PlanDefinition(said.id or file.stem, file.name, FORMAT, content, said.arguments)


def check(scenario: Scenario) -> None:
    """Refuse what would fail during the run.

    Raises:
        FormatError: something does not fit; the text names the entry.
    """
    _check_settings(scenario)
    _check_odometry(scenario)
    _check_start(scenario)
    parts = parts_of(scenario.settings) | {FaultTarget.LINK}
    commands, questions = _labels(scenario, Send, model.Fix), _labels(scenario, QueryParameters)
    for label in scenario.false_executed:
        if not label.startswith(SOURCE_PREFIX):
            _known(label, commands, "false_executed")
    fetched = {entry.fetch for entry in scenario.timeline if isinstance(entry, Fetch)}
    for path, said in _said(scenario):
        if isinstance(said, Scheduled):
            if said.after is not None:
                _known(said.after.label, commands, f"{path}.after")
            lasting_s = said.for_s if isinstance(said, ScheduledInterval) else 0.0
            if said.at_s is not None and said.at_s + lasting_s > scenario.lasts_s:
                raise FormatError(path, f"is later than the end, {scenario.lasts_s:g} s")
            if said.at_end and isinstance(said, Entry):
                raise FormatError(path, "at, after or near is needed")
        match said:
            case Repeat(repeat=label):
                _known(label, commands, f"{path}.repeat")
            case model.Inject(inject=fault) if why := lacking(type(fault), parts):
                raise FormatError(f"{path}.inject", f"{why} ({scenario.settings.asset})")
            case of_commands.ExpectedLife(command=label):
                _known(label, commands, f"{path}.command")
            case of_commands.FileFetched(fetched=label):
                _known(label, fetched, f"{path}.fetched")
            case of_rover.ParameterIs(asked=str(label)) | of_commands.FileList(asked=label):
                _known(label, questions, f"{path}.asked")
            case _:
                pass


def _check_settings(scenario: Scenario) -> None:
    settings, camera = scenario.settings, scenario.settings.camera
    tick_s = settings.tick_s
    if not STEP_S <= tick_s <= 1 or abs(round(tick_s / STEP_S) * STEP_S - tick_s) > 1e-9:
        raise FormatError("settings.tick", f"{tick_s:g} s is no multiple of {STEP_S:g} s up to 1 s")
    speeds = {
        f"drive.{each.name}": getattr(settings.drive, each.name) for each in fields(settings.drive)
    }
    for name, value in {**speeds, "camera.rotate_speed_radps": camera.rotate_speed_radps}.items():
        if value <= 0:
            raise FormatError("settings", f"{name} {value:g} is not above 0")
    size_px = (camera.width_px, camera.height_px)
    for name, size, most in zip(("width", "height"), size_px, _LARGEST_PX, strict=True):
        if not 1 <= size <= most:
            raise FormatError(f"settings.camera.{name}", f"{shown(size)} is not in 1 .. {most}")
    if settings.locomotion is LocomotionKind.WHOLE_MOTION and settings.sensors.present:
        raise FormatError("settings.sensors", f"{settings.asset} is simulated without any of them")


def _check_start(scenario: Scenario) -> None:
    """Refuse a start in a keep-out zone or a rock, or outside a keep-in zone."""
    start = scenario.world.start_pose.point
    for obstacle in scenario.settings.zones:
        if obstacle.clearance_m(start, start) <= 0:
            raise FormatError(
                "settings.zones",
                f"the start of the world, x {start.x_m:g} y {start.y_m:g}, is not on the right side"
                f" of {obstacle.title}",
            )


def _check_odometry(scenario: Scenario) -> None:
    odometry = scenario.odometry
    if scenario.settings.locomotion is LocomotionKind.WHOLE_MOTION and not _usual(odometry):
        raise FormatError("odometry", f"that of {scenario.settings.asset} is its brick's own")
    for name in ("encoder_noise_mps", "gyro_noise_radps", "lean_noise_rad"):
        if getattr(odometry, name) < 0:
            raise FormatError("odometry", f"{name} {getattr(odometry, name):g} is below 0")


def _usual(odometry: OdometrySettings) -> bool:
    return odometry == OdometrySettings()


def _said(scenario: Scenario) -> Iterator[tuple[str, Entry | Expectation]]:
    """Yield all entries and expectations, each with its path in the file."""
    for index, entry in enumerate(scenario.timeline):
        yield f"timeline[{index}]", entry
    for index, expected in enumerate(scenario.expect):
        yield f"expect[{index}]", expected


def _labels(scenario: Scenario, *kinds: type[Send | model.Fix | QueryParameters]) -> set[str]:
    labels: set[str] = set()
    for index, entry in enumerate(scenario.timeline):
        if not isinstance(entry, kinds):
            continue
        label = entry.ask if isinstance(entry, QueryParameters) else entry.name
        if not re.fullmatch(r"\S+", label):
            raise FormatError(f"timeline[{index}]", f"{label!r} is no label: it has a space")
        if label in labels:
            text = f"there is a {label!r} already: give it a label"
            raise FormatError(f"timeline[{index}]", text)
        labels.add(label)
    return labels


def _known(label: str, labels: set[str], path: str) -> None:
    if label not in labels:
        raise FormatError(path, f"no {label!r} in timeline; known are {', '.join(sorted(labels))}")


def check_play_mode(scenario: Scenario, mode: RunMode) -> None:
    """Look for what cannot be played this way.

    Raises:
        FormatError: there is such an entry or expectation.
    """
    if mode is not RunMode.LOCK_STEP and not _usual(scenario.odometry):
        raise FormatError("odometry", "works in lock step only")
    for path, said in _said(scenario):
        for key, text in _obstacles(said, mode):
            raise FormatError(f"{path}{key}", text)


def _obstacles(said: Entry | Expectation, mode: RunMode) -> Iterator[tuple[str, str]]:
    live, relay = mode is not RunMode.LOCK_STEP, mode is RunMode.RELAY
    match said:
        case model.Crash() if live:
            yield "", "crash works in lock step only"
        case model.Fix() if live:
            yield "", "fix works in lock step only"
        case model.Inject(inject=LinkLost()) if relay:
            yield ".inject", "by the relay the link is lost by an eclipse, which is planned"
        case Send(link=str(link)) | Repeat(link=str(link)) if live and link not in LINKS:
            yield ".link", f"{link!r} works in lock step only"
        case of_rover.Contacts() if live:
            yield ".contacts", "what the rover touches is known in lock step only"
        case of_rover.VideoComes() if not live:
            yield ".video", "video works with --live only"
        case of_commands.LinkNotificationCount() if not relay:
            yield ".link", "works with --live --link relay only"
        case Fetch() if relay:
            yield "", "files do not travel by the relay"
        case Send(replace=True, link=link) if live and (link or mode.link) == RunMode.RELAY.link:
            yield ".replace", "commands by the relay wait their turn"
        case model.Eclipse(at_s=at_s, near=near) if relay and (at_s is None or near):
            yield "", "by the relay an eclipse is planned: it needs at, and no near"
        case model.Eclipse(at_s=float(at_s), eclipse_s=dark_s) if relay:
            if not (at_s.is_integer() and dark_s.is_integer()):
                yield "", "by the relay an eclipse begins and ends at whole seconds"
        case (
            of_commands.FileEventsExpectation()
            | of_commands.FileList()
            | of_commands.FileFetched()
            | of_commands.PlanIs()
            | of_rover.VideoComes()
        ) if relay:
            yield f".{next(iter(said.__slots__))}", "does not travel by the relay"
        case _:
            pass
