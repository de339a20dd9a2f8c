"""The commands `rover status` (mode, commands, parameters) and `rover services` (directory)."""

import asyncio
import sys
from collections.abc import AsyncIterator, Awaitable, Mapping
from dataclasses import dataclass, replace
from math import degrees
from typing import TYPE_CHECKING, Any, Final, TypeVar

import click

from adapters.mal import MalError
from adapters.mrs.cli.authority_command import authority_line
from adapters.mrs.cli.options import RoverTarget, json_option, to_option
from adapters.mrs.cli.terminal import (
    connect,
    echo_json,
    echo_line,
    in_session,
    iso,
    print_table,
    run,
    table,
    utc,
)
from adapters.mrs.ground import LinkDelay, MrsClient
from adapters.mrs.spec import (
    MAP_HOUSEKEEPING,
    POSE_HOUSEKEEPING,
    ActiveFault,
    AreaError,
    AssetInfo,
    AssetMode,
    AssetStatus,
    AuthorityStatus,
    CameraState,
    FaultReaction,
    FaultStatus,
    ParameterDefinition,
    ServiceDescriptor,
    display_name,
    find_service,
    received_value,
)
from executive.faults import summary
from executive.state import RECOVERY, Uncertainty
from executive.values.geometry import Pose
from executive.values.quantities import display_unit
from executive.values.reasons import Reason
from executive.values.reports import PlanStatus, PlanUpdate, printable

if TYPE_CHECKING:
    from rich.console import Group

T = TypeVar("T")

REFRESH_S: Final = 0.5
LATE_TICK_S: Final = 0.15
"""Time between ticks above which the computer aboard is busy: three ticks."""
_NOT_BY_LATE_TICKS: Final = {
    each.value
    for each in (
        Reason.TILT_LIMIT,
        Reason.EMERGENCY_STOP,
        Reason.BATTERY_LOW,
        Reason.OTHER_PUBLISHER,
        Reason.ZONE_AHEAD,
        Reason.OBSTACLE_AHEAD,
        Reason.OBSTACLE_NEAR,
        Reason.LASER_BLIND,
        Reason.WHEELS_UNPOWERED,
        Reason.NAVIGATION_UNCOMMANDED_MOTION,
    )
}
"""Faults that a busy computer does not cause."""
SLOW_DISK_S: Final = 0.1
"""Waiting time of reports above which the disk of the ledger is slow; chosen, not measured."""
MIN_LATE_TICKS: Final = 20
"""Late ticks, those of a second, that may have caused a fault."""
_RESUME: Final = "rover resume"
_HOLDING: Final = {FaultReaction.PAUSE, FaultReaction.STOP, FaultReaction.SAFE}


@click.command()
@to_option
@click.option("--watch", is_flag=True, help="Refresh it until Ctrl-C.")
@json_option
@click.option("--assets", is_flag=True, help="List this rover and the assets known to it.")
@click.option("--asset", metavar="NAME", help="Show the last values received of another asset.")
def status(to: RoverTarget, watch: bool, as_json: bool, assets: bool, asset: str | None) -> None:
    """Show the state of a rover: mode, commands, and all parameters with their units.

    \b
    Examples:
      rover status
      rover status --watch
      rover status --json | jq .parameters.BATERY_VOLTAGE.value
      rover status --assets
    """
    if assets and asset is not None:
        raise click.UsageError("either --assets or --asset")
    if watch and (assets or asset is not None):
        raise click.UsageError("--watch shows only the rover itself")
    if assets:
        run(_show_assets(to, as_json))
    elif asset is not None:
        run(_show_asset(to, asset, as_json))
    else:
        run(_show(to, watch, as_json))


@dataclass(frozen=True, slots=True)
class _StatusSnapshot:
    """State of a rover at one time."""

    asset: AssetInfo
    definitions: tuple[ParameterDefinition, ...]
    camera: CameraState
    status: AssetStatus
    faults: FaultStatus | None
    suspended: tuple[PlanUpdate, ...]
    authority: AuthorityStatus | None
    delay: LinkDelay

    @property
    def values(self) -> dict[str, float | str | None]:
        """Figures of the parameters, None if unknown."""
        return {each.name: each.value for each in map(received_value, self.status.values)}

    def as_json(self) -> dict[str, Any]:
        """Return the state as printed with --json."""
        values, faults = self.values, self.faults
        return {
            "asset": self.asset.asset,
            "time": iso(self.status.timestamp / 1e9),
            "mode": self.status.mode,
            "activeCommandId": self.status.activeCommandId,
            "queuedCommands": self.status.queuedCommands,
            "activePlan": self.status.activePlan,
            "videoOn": self.camera.videoOn,
            "authority": self.authority,
            "roundTrip": self.delay.round_trip_s,
            "why": faults.why if faults else None,
            "faults": faults.active if faults else None,
            "unmonitored": faults.unmonitored if faults else None,
            "parameters": {
                definition.name: {"value": values.get(definition.name), "unit": definition.unit}
                for definition in self.definitions
            },
        }

    def as_table(self) -> "Group":
        """Return the state for display."""
        from rich.console import Group
        from rich.text import Text

        values, mode, faults = self.values, self.status.mode, self.faults
        lines = (
            *(_why(faults) if faults else ()),
            *late_ticks(values, faults),
            *slow_disk(values),
            _work_line(self.status),
            *_recovery_lines(mode, self.suspended, faults),
            *((f"the pose is uncertain: {RECOVERY}",) if _uncertainty(values) else ()),
            *((authority_line(self.authority),) if self.authority else ()),
            _position_text(values, self.camera),
            _not_monitored(faults),
            *((_delay_line(self.delay),) if self.delay.is_noticeable else ()),
            f"{utc(self.status.timestamp)} UTC aboard",
        )
        rows = (
            (display_name(each), *_shown(values.get(each.name), each.unit or ""), each.name)
            for each in self.definitions
        )
        return Group(
            Text(printable(f"{self.asset.asset}  {mode.name}"), style="bold"),
            *(Text(printable(line)) for line in lines),
            table(rows, "parameter", "value", "unit", "name"),
        )


async def _show(to: RoverTarget, watch: bool, as_json: bool) -> None:
    from rich.console import Console
    from rich.live import Live

    console = Console()
    async with await connect(to) as client:
        snapshots = _snapshots(client)
        if watch and not as_json and console.is_terminal:
            first = await anext(snapshots)
            with Live(first.as_table(), console=console, auto_refresh=False) as live:
                async for snapshot in snapshots:
                    live.update(snapshot.as_table(), refresh=True)
        async for snapshot in snapshots:
            if as_json:
                echo_json(snapshot.as_json())
            else:
                console.print(snapshot.as_table())
                sys.stdout.flush()
            if not watch:
                return


async def _snapshots(client: MrsClient) -> AsyncIterator[_StatusSnapshot]:
    now_s = asyncio.get_running_loop().time
    asset, definitions = await asyncio.gather(client.get_asset(), client.list_definition())
    while True:
        requested_s = now_s()
        camera, status, faults, authority = await asyncio.gather(
            client.get_camera_state(),
            client.get_status(),
            _answer_or(client.get_faults(), None),
            _answer_or(client.authority.status(), None),
        )
        delay = replace(client.delay, measured_s=now_s() - requested_s)
        suspended = await suspended_plans(client, status.mode)
        yield _StatusSnapshot(
            asset, definitions, camera, status, faults, suspended, authority, delay
        )
        await asyncio.sleep(REFRESH_S)


async def _answer_or(answer: Awaitable[T], instead: T) -> T:
    """Return an answer, or `instead` if the operation is not supported, as at an orbiter."""
    try:
        return await answer
    except MalError:
        return instead


async def suspended_plans(client: MrsClient, mode: AssetMode) -> tuple[PlanUpdate, ...]:
    """Return the suspended plans of a stopped rover; none if plans are not supported."""
    if mode not in {AssetMode.PAUSED, AssetMode.SAFE, AssetMode.STOPPED}:
        return ()
    plans = await _answer_or(client.get_plan_status(), ())
    return tuple(plan for plan in plans if plan.status is PlanStatus.SUSPENDED)


def _delay_line(delay: LinkDelay) -> str:
    """Return the round-trip time in one line: this state is half of it old."""
    return f"round trip {delay.round_trip_s:.1f} s, declared {delay.declared_s:g} s"


def _work_line(status: AssetStatus) -> str:
    """Return the active command, the queue and the active plan in one line."""
    if status.activeCommandId is None and not status.queuedCommands:
        doing = "no command active, queue empty"
    else:
        active = "none" if status.activeCommandId is None else str(status.activeCommandId)
        doing = f"active command {active}, {status.queuedCommands} queued"
    return doing if status.activePlan is None else f"{doing}, plan {status.activePlan}"


def _position_text(values: dict[str, float | str | None], camera: CameraState) -> str:
    """Return pose and video state of the rover in one line."""
    x, y, heading = values.get("POS_X"), values.get("POS_Y"), values.get("HEAD")
    video = f"video {'on' if camera.videoOn else 'off'}"
    if not (isinstance(x, float) and isinstance(y, float) and isinstance(heading, float)):
        return f"position unknown, {video}"
    pose = f"at {_pose_text(Pose(x, y, heading_rad=heading))}"
    map_x, map_y, turned = (values.get(each.name) for each in MAP_HOUSEKEEPING)
    if isinstance(map_x, float) and isinstance(map_y, float) and isinstance(turned, float):
        origin = Pose(map_x, map_y, heading_rad=turned)
        in_map = origin.inverse.compose(Pose(x, y, heading_rad=heading))
        pose += f" in odom, {_pose_text(in_map)} in the map"
    uncertainty = _uncertainty(values)
    return f"{pose}, uncertain by {uncertainty}, {video}" if uncertainty else f"{pose}, {video}"


def _pose_text(pose: Pose) -> str:
    return f"x {pose.x_m:z.2f} m, y {pose.y_m:z.2f} m, heading {degrees(pose.heading_rad):z.1f}°"


def _uncertainty(values: dict[str, float | str | None]) -> Uncertainty:
    """Return the reported uncertainty of the pose; zero if not reported."""
    position_m, heading_rad = (values.get(each.name) for each in POSE_HOUSEKEEPING)
    if not (isinstance(position_m, float) and isinstance(heading_rad, float)):
        return Uncertainty()
    return Uncertainty(position_m, heading_rad)


def _why(faults: FaultStatus) -> tuple[str, ...]:
    """Return the reason for standstill or motion, and one line for each fault."""
    return (faults.why, *(_fault_line(each, faults.why) for each in faults.active))


def _fault_line(fault: ActiveFault, why: str) -> str:
    """Return a fault in one line: severity, name, start, reaction, evidence.

    The evidence is omitted if `why` contains it.
    """
    until = "until a resume" if fault.onResume else "while it persists"
    done = f"{fault.reaction.name.lower()} {until}"
    evidence = "" if fault.text in why else f": {fault.text}"
    return f"{fault.severity.name} {fault.name} since {utc(fault.began)} UTC, {done}{evidence}"


def late_ticks(
    values: Mapping[str, float | str | None], faults: FaultStatus | None
) -> tuple[str, ...]:
    """Return a line if ticks are late, or were before an active fault: its probable cause."""
    period_s, late = values.get("EXEC_TICK_PERIOD"), values.get("EXEC_OVERRUNS")
    if not (isinstance(period_s, float) and isinstance(late, float)):
        return ()
    causable = faults and any(each.code not in _NOT_BY_LATE_TICKS for each in faults.active)
    cause = ", the probable cause of the faults" if causable else ""
    if period_s < LATE_TICK_S and not (cause and late >= MIN_LATE_TICKS):
        return ()
    text = f"the computer aboard is too slow or busy{cause}: {late:.0f} late ticks since the start"
    return (f"{text} (EXEC_OVERRUNS), up to {period_s:.2f} s from tick to tick now",)


def slow_disk(values: Mapping[str, float | str | None]) -> tuple[str, ...]:
    """Return a line if reports and answers wait for the disk of the ledger."""
    waiting, wait_s = values.get("EXEC_UNWRITTEN"), values.get("EXEC_COMMIT_WAIT")
    if not (isinstance(waiting, float) and isinstance(wait_s, float)) or wait_s < SLOW_DISK_S:
        return ()
    return (f"the disk aboard is slow: {waiting:.0f} commits wait, the first for {wait_s:.1f} s",)


def _not_monitored(faults: FaultStatus | None) -> str:
    """Return in one line the checks that do not run, by reason."""
    if faults is None:
        return "active faults are not listed here, only reported as events"
    return f"not monitored: {summary(faults.unmonitored)}"


def _recovery_lines(
    mode: AssetMode, suspended: tuple[PlanUpdate, ...], faults: FaultStatus | None
) -> tuple[str, ...]:
    """Return the commands that let a stopped rover continue, and its suspended plans."""
    lines: list[str] = []
    holding = [each for each in faults.active if each.reaction in _HOLDING] if faults else []
    if holding:
        if any(each.onResume for each in holding):
            lines.append(f"to continue, once the cause is cleared: {_RESUME}")
    elif mode is AssetMode.STOPPED:
        lines.append(f"to continue: {_RESUME}")
    elif mode is AssetMode.SAFE:
        where = "" if faults else "rover watch shows the reason; "
        lines.append(f"{where}to continue, once the cause is cleared: {_RESUME}")
    for plan in suspended:
        lines.append(f"plan {plan.plan_id} is suspended: {plan.text}")
        lines.append(f"to continue: rover plan resume {plan.plan_id}")
    return tuple(lines)


async def _show_assets(to: RoverTarget, as_json: bool) -> None:
    """Print the rover and the assets known to it, with their modes."""
    async with await connect(to) as client:
        assets = await client.list_assets()
    if as_json:
        for each in assets:
            echo_json({"asset": each.asset, "mode": each.mode})
        return
    rows = ((each.asset, each.mode.name, each.softwareVersion, each.description) for each in assets)
    print_table(rows, "asset", "mode", "software", "description")


async def _show_asset(to: RoverTarget, asset: str, as_json: bool) -> None:
    """Print the last values that the rover received of another asset.

    Raises:
        click.UsageError: the asset is unknown.
    """
    async with await connect(to) as client:
        try:
            values = await client.get_asset_value(asset)
        except MalError as error:
            if error.number != AreaError.NOT_FOUND.value:
                raise
            text = f"--asset: {asset} is unknown; `rover status --assets` lists the known assets"
            raise click.UsageError(text) from error
        units = {each.name: each.unit or "" for each in await client.list_definition()}
    if as_json:
        found = {each.name: {"value": each.value, "time": iso(each.utc_s)} for each in values}
        echo_json({"asset": asset, "parameters": found})
        return
    rows = (
        (each.name, *_shown(each.value, units.get(each.name, "")), iso(each.utc_s))
        for each in values
    )
    print_table(rows, "parameter", "value", "unit", "sampled, UTC")


def _shown(figure: float | str | None, unit: str) -> tuple[str, str]:
    """Return a value and its unit, for display: angles in degrees."""
    if figure is None or isinstance(figure, str):
        return "unknown" if figure is None else printable(figure), unit
    per_unit, shown_unit = display_unit(unit)
    return f"{figure * per_unit:z.3f}", shown_unit


@click.command()
@in_session
async def services(client: MrsClient) -> None:
    """List the services of a rover: operations, provider and broker of each.

    A client needs only the address of this directory, and finds all services in it.
    Registered services of other assets are named ASSET.SERVICE.

    \b
    Examples:
      rover services
      rover services --to rover.local:21000
    """
    asset, found = await client.get_asset(), await client.get_services()
    echo_line(f"{asset.asset}  {asset.mode.name}")
    echo_line(asset.description)
    echo_line(f"domain {'.'.join(asset.domain)}, software {asset.softwareVersion}")
    click.echo()
    for provider in dict.fromkeys(each.providerURI for each in found):
        echo_line(provider)
        rows = (
            (each.name, "; ".join(filter(None, (", ".join(_operations(each)), each.brokerURI))))
            for each in found
            if each.providerURI == provider
        )
        print_table(rows, "service", "operations; broker")


def _operations(descriptor: ServiceDescriptor) -> list[str]:
    """Return the names of the operations; the number if the interface lacks one."""
    service = find_service(descriptor.service)
    names = {each.number: each.name for each in service.operations} if service else {}
    return [names.get(number, str(number)) for number in descriptor.operations]
