"""`load_scenario` reads a scenario file, or raises one error that names the file and the key.

Labels must exist, times lie within the run, and the mode of the run support the whole file.
"""

import json
import re
from collections.abc import Iterator, Sequence
from contextvars import ContextVar
from dataclasses import dataclass, field, fields, make_dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

from executive.commands import (
    CommandDeclaration,
    OnlyAt,
    PlanArgument,
    PlanDefinition,
    Request,
    SubmitPlan,
    all_declarations,
    declaration_of,
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
    quoted,
    settings_reader,
)
from sim.rover import World, load_world
from sim.rover.faults import (
    FaultTarget,
    LinkLost,
    SimulatedFault,
    fault_declaration,
    fault_targets_of,
    format_fault,
    read_fault,
    read_kind,
    unsupported_reason,
)
from sim.rover.jackal import SimulatedOdometry
from sim.rover.lockstep import STEP_S
from sim.scenario import expect_commands as of_commands
from sim.scenario import expect_rover as of_rover
from sim.scenario import model
from sim.scenario.changes import Override, apply_overrides
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
OPERATIONS: Final = {each.name: each for each in all_declarations()}
LINKS: Final = tuple(each.link for each in (RunMode.DIRECT, RunMode.RELAY))
"""Links of live runs."""
_MAX_PX: Final = (1280, 960)
_PLAIN: Final = StrictReader({})
_FOLDER: Final[ContextVar[Path]] = ContextVar("folder")
"""Folder of the file that is being read; plans are found in it."""


def scenario_folder() -> Path:
    """Return the folder of the named scenarios."""
    return config_folder() / "scenarios"


def scenario_path(name: str) -> Path:
    """Return the file of a scenario from its path or its name in config/scenarios.

    Raises:
        SettingsError: there is none of that name.
    """
    return path_of("scenario", name, scenario_folder())


def path_of(kind: str, name: str, folder: Path) -> Path:
    """Return the file with a path, or with a name in a folder.

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
        mode: planned mode of the run, which the scenario must support; None for no run.
        changes: overrides of the file, applied in order before it is checked.

    Raises:
        SettingsError: there is no such scenario, or it is not valid. If an override causes that,
            the text names it.
    """
    path = scenario_path(name)
    return read_scenario(load_yaml(path), path, mode, changes)


def read_scenario(
    raw: object, path: Path, mode: RunMode | None = None, changes: Sequence[Override] = ()
) -> Scenario:
    """Return the scenario of the content of a file; see `load_scenario`."""
    try:
        return _checked(raw, path.parent, mode, changes)
    except FormatError as error:
        blamed = _first_invalid_change(raw, path.parent, mode, changes)
        cause = f": changed by {blamed}" if blamed and "changed by" not in str(error) else ""
        raise SettingsError(error.text_of(f"{path}{cause}")) from error


def _checked(
    raw: object, folder: Path, mode: RunMode | None, changes: Sequence[Override]
) -> Scenario:
    scenario = _scenario(raw, folder, changes)
    check(scenario)
    if mode is not None:
        check_run_mode(scenario, mode)
    return scenario


def _first_invalid_change(
    raw: object, folder: Path, mode: RunMode | None, changes: Sequence[Override]
) -> Override | None:
    """Return the last override before which the data were valid; None if they never were."""
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
    raw = apply_overrides(raw, changes, lambda name: reader.plain(_world(name, folder, reader)))
    settings = _settings(raw.get("asset", "jackal"), folder)
    filled = {
        **raw,
        "settings": reader.overlay(settings, raw.get("settings", {}), "settings"),
        "world": _world(raw.get("world", "flat"), folder, reader),
    }
    return reader.read(filled, Scenario)


@cache
def _reader() -> StrictReader:
    """Return the reader of scenarios, cached: its creation costs more than reading 100 files."""
    reader = settings_reader(
        {
            StageTime: lambda raw: StageTime.parse(_text(raw, "")),
            OnlyAt: lambda raw: _only_at(_text(raw, "")),
            Request: lambda raw: read_request(raw, reader),
            SimulatedFault: read_fault,
            type[SimulatedFault]: lambda raw: read_kind(raw).kind,
        },
        {
            StageTime: lambda time: f"{time.label} {time.stage} + {time.delay_s:.9f}",
            OnlyAt: lambda bounds: bounds.wire_text,
            SimulatedFault: format_fault,
            type[SimulatedFault]: lambda kind: fault_declaration(kind).name,
            **{each.kind: write_request for each in all_declarations()},
        },
    )
    return reader


def _only_at(text: str) -> OnlyAt:
    """Return the bounds of a file, or of a recorded timeline, where they have all their digits."""
    return OnlyAt.read(text) if "," in text else OnlyAt.parse(text)


@dataclass(frozen=True, slots=True)
class _Timeline:
    timeline: tuple[Entry, ...]


def write_timeline(timeline: tuple[Entry, ...]) -> str:
    """Return a timeline as text that `read_timeline` reads."""
    return json.dumps(_reader().plain(_Timeline(timeline)))


def read_timeline(text: str) -> tuple[Entry, ...]:
    """Return the timeline of a recording.

    Raises:
        FormatError: the text is not valid, for example of another version.
        ValueError: it is no JSON.
    """
    return _reader().read(json.loads(text), _Timeline).timeline


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
        raise FormatError(path, f"expected a text, got {quoted(raw)}")
    return raw


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanFile:
    """A plan to submit.

    Attributes:
        plan: name in config/plans, or XML file beside the scenario.
        id: plan id of the submission; None is the file's name.
        content: the plan itself; None reads the file.
    """

    plan: str
    id: str | None = None
    arguments: tuple[PlanArgument, ...] = ()
    content: str | None = None


def read_request(raw: Any, reader: StrictReader) -> Request:
    """Return the request that a file describes.

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
    made = reader.read(arguments, _file_type(declaration), name)
    request: Request = declaration.build_request(
        *(getattr(made, each.field) for each in declaration.user_arguments)
    )
    return request


def write_request(request: Request) -> dict[str, object]:
    """Return a request as `read_request` reads it; a plan with its content."""
    declaration = declaration_of(type(request))
    made: object = request
    if isinstance(request, SubmitPlan):
        plan = request.plan
        made = PlanFile(
            plan=plan.name, id=plan.plan_id, arguments=plan.arguments, content=plan.content.decode()
        )
    elif declaration.composite is not None:
        first, *others = (getattr(request, each.name) for each in fields(request))
        parts = (getattr(first, each.name) for each in fields(declaration.composite))
        made = _file_type(declaration)(*parts, *others)
    return {declaration.name: _PLAIN.plain(made)}


@cache
def _file_type(declaration: CommandDeclaration) -> Any:
    """Return the dataclass of a request in a file, with the fields of its composite, if any."""
    if declaration.composite is None:
        return declaration.kind
    _, *others = fields(declaration.kind)
    written = [
        (each.name, each.type, field(default=each.default))
        for each in (*fields(declaration.composite), *others)
    ]
    return make_dataclass(declaration.kind.__name__, written)


def _plan(entry: PlanFile, path: str) -> PlanDefinition:
    named = config_folder() / "plans" / f"{entry.plan}.xml"
    file = _FOLDER.get(Path()) / entry.plan if entry.plan.endswith(".xml") else named
    try:
        content = file.read_bytes() if entry.content is None else entry.content.encode()
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) else error
        raise FormatError(path, f"{entry.plan!r} cannot be read ({why})") from error
    return PlanDefinition(entry.id or file.stem, file.name, FORMAT, content, entry.arguments)


def check(scenario: Scenario) -> None:
    """Check a scenario for errors that would fail during the run.

    Raises:
        FormatError: an entry is not valid; the text names it.
    """
    _check_settings(scenario)
    _check_odometry(scenario)
    _check_start(scenario)
    parts = fault_targets_of(scenario.settings) | {FaultTarget.LINK}
    commands, queries = _labels(scenario, Send, model.Fix), _labels(scenario, QueryParameters)
    for label in scenario.false_executed:
        if not label.startswith(SOURCE_PREFIX):
            _require_label(label, commands, "false_executed")
    fetched = {entry.fetch for entry in scenario.timeline if isinstance(entry, Fetch)}
    for path, item in _entries_with_paths(scenario):
        if isinstance(item, Scheduled):
            if item.after is not None:
                _require_label(item.after.label, commands, f"{path}.after")
            lasting_s = item.for_s if isinstance(item, ScheduledInterval) else 0.0
            if item.at_s is not None and item.at_s + lasting_s > scenario.duration_s:
                raise FormatError(path, f"is later than the end, {scenario.duration_s:g} s")
            if item.at_end and isinstance(item, Entry):
                raise FormatError(path, "at, after or near is needed")
        match item:
            case Repeat(repeat=label):
                _require_label(label, commands, f"{path}.repeat")
            case Send(only_after=str(label)):
                _require_label(label, commands, f"{path}.only_after")
            case model.Inject(inject=fault) if why := unsupported_reason(type(fault), parts):
                raise FormatError(f"{path}.inject", f"{why} ({scenario.settings.asset})")
            case of_commands.LifecycleExpectation(command=label):
                _require_label(label, commands, f"{path}.command")
            case of_commands.FileFetched(fetched=label):
                _require_label(label, fetched, f"{path}.fetched")
            case of_rover.ParameterIs(query=str(label)) | of_commands.FileList(query=label):
                _require_label(label, queries, f"{path}.query")
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
        if value is not None and value <= 0:
            raise FormatError("settings", f"{name} {value:g} is not above 0")
    size_px = (camera.width_px, camera.height_px)
    for name, size, bound in zip(("width", "height"), size_px, _MAX_PX, strict=True):
        if not 1 <= size <= bound:
            raise FormatError(f"settings.camera.{name}", f"{quoted(size)} is not in 1 .. {bound}")
    if settings.locomotion is LocomotionKind.DELEGATED and settings.sensors.present:
        raise FormatError("settings.sensors", f"{settings.asset} is simulated without sensors")


def _check_start(scenario: Scenario) -> None:
    """Raise FormatError for a start in a keep-out zone or a rock, or outside a keep-in zone."""
    start = scenario.world.start_pose.point
    for obstacle in scenario.settings.zones:
        if obstacle.clearance_m(start, start) <= 0:
            raise FormatError(
                "settings.zones",
                f"the start of the world, x {start.x_m:g} y {start.y_m:g}, is not on the right side"
                f" of {obstacle.label}",
            )


def _check_odometry(scenario: Scenario) -> None:
    odometry = scenario.odometry
    if scenario.settings.locomotion is LocomotionKind.DELEGATED and not _usual(odometry):
        raise FormatError("odometry", f"that of {scenario.settings.asset} is its brick's own")
    for name in ("encoder_noise_mps", "gyro_noise_radps", "tilt_noise_rad"):
        if getattr(odometry, name) < 0:
            raise FormatError("odometry", f"{name} {getattr(odometry, name):g} is below 0")


def _usual(odometry: SimulatedOdometry) -> bool:
    return odometry == SimulatedOdometry()


def _entries_with_paths(scenario: Scenario) -> Iterator[tuple[str, Entry | Expectation]]:
    """Yield all entries and expectations with their paths in the file."""
    for index, entry in enumerate(scenario.timeline):
        yield f"timeline[{index}]", entry
    for index, expected in enumerate(scenario.expect):
        yield f"expect[{index}]", expected


def _labels(scenario: Scenario, *kinds: type[Send | model.Fix | QueryParameters]) -> set[str]:
    labels: set[str] = set()
    for index, entry in enumerate(scenario.timeline):
        if not isinstance(entry, kinds):
            continue
        label = entry.query if isinstance(entry, QueryParameters) else entry.name
        if not re.fullmatch(r"\S+", label):
            raise FormatError(f"timeline[{index}]", f"{label!r} is no label: it has a space")
        if label in labels:
            text = f"there is a {label!r} already: add another label"
            raise FormatError(f"timeline[{index}]", text)
        labels.add(label)
    return labels


def _require_label(label: str, labels: set[str], path: str) -> None:
    if label not in labels:
        raise FormatError(path, f"no {label!r} in timeline; known are {', '.join(sorted(labels))}")


def check_run_mode(scenario: Scenario, mode: RunMode) -> None:
    """Check that a mode of running supports all of a scenario.

    Raises:
        FormatError: an entry or expectation does not work in this mode.
    """
    if mode is not RunMode.LOCK_STEP and not _usual(scenario.odometry):
        raise FormatError("odometry", "works in lock step only")
    for path, item in _entries_with_paths(scenario):
        for key, text in _obstacles(item, mode):
            raise FormatError(f"{path}{key}", text)


def _obstacles(entry: Entry | Expectation, mode: RunMode) -> Iterator[tuple[str, str]]:
    live, relay = mode is not RunMode.LOCK_STEP, mode is RunMode.RELAY
    match entry:
        case model.Crash() if live:
            yield "", "crash works in lock step only"
        case model.Fix() if live:
            yield "", "fix works in lock step only"
        case model.Inject(inject=LinkLost()) if relay:
            yield ".inject", "link_lost does not work over the relay: use a planned outage"
        case Send(link=str(link)) | Repeat(link=str(link)) if live and link not in LINKS:
            yield ".link", f"{link!r} works in lock step only"
        case of_rover.Contacts() if live:
            yield ".contacts", "contacts are known in lock step only"
        case of_rover.VideoExpectation() if not live:
            yield ".video", "video works with --live only"
        case of_commands.LinkNotificationCount() if not relay:
            yield ".link", "works with --live --link relay only"
        case Fetch() if relay:
            yield "", "files do not travel over the relay"
        case Send(replace=True, link=link) if live and (link or mode.link) == RunMode.RELAY.link:
            yield ".replace", "commands over the relay are always queued"
        case model.Outage(at_s=at_s, near=near) if relay and (at_s is None or near):
            yield "", "over the relay an outage is planned: it needs at, and no near"
        case model.Outage(at_s=float(at_s), outage_s=dark_s) if relay:
            if not (at_s.is_integer() and dark_s.is_integer()):
                yield "", "over the relay an outage begins and ends at whole seconds"
        case (
            of_commands.FileEventsExpectation()
            | of_commands.FileList()
            | of_commands.FileFetched()
            | of_commands.PlanIs()
            | of_rover.VideoExpectation()
        ) if relay:
            yield f".{next(iter(entry.__slots__))}", "does not travel over the relay"
        case _:
            pass
