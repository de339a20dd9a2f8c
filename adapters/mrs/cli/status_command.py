"""What a rover is: `rover status`, its mode, work and parameters, and `rover services`."""

import asyncio
import sys
from collections.abc import AsyncIterator, Awaitable
from dataclasses import dataclass
from math import degrees
from typing import TYPE_CHECKING, Any, Final, TypeVar

import click

from adapters.mal import MalError
from adapters.mrs.cli.authority_command import authority_line
from adapters.mrs.cli.options import RoverTarget, json_option, to_option
from adapters.mrs.cli.terminal import (
    connect,
    echo_json,
    in_session,
    iso,
    print_table,
    run,
    say,
    table,
    utc,
)
from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import (
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
    ParameterValue,
    PlanStatus,
    PlanUpdate,
    ServiceDescriptor,
    find_service,
)
from executive.safety import summary
from executive.state import Uncertainty
from executive.values.reports import printable

if TYPE_CHECKING:
    from rich.console import Group

T = TypeVar("T")

EVERY_S: Final = 0.5
_RESUME: Final = "rover command resume"
_CONFIRM: Final = (
    "to be certain of the pose again: correct it by rover command setPositionCompensation,"
    " or confirm it by rover command confirmPose"
)
_HOLDING: Final = {FaultReaction.PAUSE, FaultReaction.STOP, FaultReaction.SAFE}


@click.command()
@to_option
@click.option("--watch", is_flag=True, help="Go on showing it until Ctrl-C.")
@json_option
@click.option("--assets", is_flag=True, help="List this rover and all others that it heard of.")
@click.option("--asset", metavar="NAME", help="Show what this rover last heard of another.")
def status(to: RoverTarget, watch: bool, as_json: bool, assets: bool, asset: str | None) -> None:
    """Show what a rover is about: mode, commands, and all parameters with their units.

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
        raise click.UsageError("--watch shows the rover itself")
    if assets:
        run(_show_assets(to, as_json))
    elif asset is not None:
        run(_show_asset(to, asset, as_json))
    else:
        run(_show(to, watch, as_json))


@dataclass(frozen=True, slots=True)
class _StatusSnapshot:
    """A rover's state at a moment."""

    asset: AssetInfo
    definitions: tuple[ParameterDefinition, ...]
    camera: CameraState
    status: AssetStatus
    faults: FaultStatus | None
    suspended: tuple[PlanUpdate, ...]
    authority: AuthorityStatus | None

    @property
    def values(self) -> dict[str, float | str | None]:
        """The figures of the parameters, None for what is not known."""
        return {value.name: _figure(value) for value in self.status.values}

    def as_json(self) -> dict[str, Any]:
        """Return it as it is printed with --json."""
        values, faults = self.values, self.faults
        return {
            "asset": self.asset.asset,
            "time": iso(self.status.timestamp),
            "mode": self.status.mode,
            "activeCommandId": self.status.activeCommandId,
            "queuedCommands": self.status.queuedCommands,
            "activePlan": self.status.activePlan,
            "videoOn": self.camera.videoOn,
            "authority": self.authority,
            "why": faults.why if faults else None,
            "faults": faults.active if faults else None,
            "unmonitored": faults.unmonitored if faults else None,
            "parameters": {
                definition.name: {"value": values.get(definition.name), "unit": definition.unit}
                for definition in self.definitions
            },
        }

    def as_table(self) -> "Group":
        """Return it as people read it."""
        from rich.console import Group
        from rich.text import Text

        values, mode, faults = self.values, self.status.mode, self.faults
        lines = (
            *(_why(faults) if faults else ()),
            _work(self.status),
            *_ways_out(mode, self.suspended, faults),
            *((_CONFIRM,) if _uncertainty(values) else ()),
            *((authority_line(self.authority),) if self.authority else ()),
            _place(values, self.camera),
            _not_monitored(faults),
            f"{utc(self.status.timestamp)} UTC aboard",
        )
        rows = (
            (each.name, _shown(values.get(each.name)), each.unit or "", each.description)
            for each in self.definitions
        )
        return Group(
            Text(printable(f"{self.asset.asset}  {mode.name}"), style="bold"),
            *(Text(printable(line)) for line in lines),
            table(rows, "parameter", "value", "unit", "meaning"),
        )


async def _show(to: RoverTarget, watch: bool, as_json: bool) -> None:
    from rich.console import Console
    from rich.live import Live

    console = Console()
    async with await connect(to) as client:
        looks = _looks(client)
        if watch and not as_json and console.is_terminal:
            first = await anext(looks)
            with Live(first.as_table(), console=console, auto_refresh=False) as live:
                async for look in looks:
                    live.update(look.as_table(), refresh=True)
        async for look in looks:
            if as_json:
                echo_json(look.as_json())
            else:
                console.print(look.as_table())
                sys.stdout.flush()
            if not watch:
                return


async def _looks(client: MrsClient) -> AsyncIterator[_StatusSnapshot]:
    asset, definitions = await client.get_asset(), await client.list_definition()
    while True:
        camera, status = await client.get_camera_state(), await client.get_status()
        faults = await _served(client.get_faults(), None)
        suspended = await _suspended_plans(client, status.mode)
        authority = await _served(client.authority.status(), None)
        yield _StatusSnapshot(asset, definitions, camera, status, faults, suspended, authority)
        await asyncio.sleep(EVERY_S)


async def _served(answer: Awaitable[T], instead: T) -> T:
    """Return an answer, or something instead where it is not served, as at an orbiter."""
    try:
        return await answer
    except MalError:
        return instead


async def _suspended_plans(client: MrsClient, mode: AssetMode) -> tuple[PlanUpdate, ...]:
    """Return the plans that wait to be resumed, if the rover stands; none where none are told."""
    if mode not in {AssetMode.PAUSED, AssetMode.SAFE, AssetMode.STOPPED}:
        return ()
    plans = await _served(client.get_plan_status(), ())
    return tuple(plan for plan in plans if plan.status is PlanStatus.SUSPENDED)


def _work(status: AssetStatus) -> str:
    """Return what is under way, and what waits."""
    if status.activeCommandId is None and not status.queuedCommands:
        doing = "nothing under way, nothing waits"
    else:
        active = "none" if status.activeCommandId is None else str(status.activeCommandId)
        doing = f"command under way {active}, {status.queuedCommands} waiting"
    return doing if status.activePlan is None else f"{doing}, plan {status.activePlan}"


def _place(values: dict[str, float | str | None], camera: CameraState) -> str:
    """Return where the rover is, and whether it films."""
    x, y, heading = values.get("POS_X"), values.get("POS_Y"), values.get("HEAD")
    video = f"video {'on' if camera.videoOn else 'off'}"
    if not (isinstance(x, float) and isinstance(y, float) and isinstance(heading, float)):
        return f"where it is, is not known now, {video}"
    place = f"at x {x:z.2f} m, y {y:z.2f} m, heading {degrees(heading):z.1f}°"
    uncertainty = _uncertainty(values)
    return f"{place}, uncertain by {uncertainty}, {video}" if uncertainty else f"{place}, {video}"


def _uncertainty(values: dict[str, float | str | None]) -> Uncertainty:
    """Return how uncertain the pose is, as far as that is reported."""
    position_m, heading_rad = (values.get(each.name) for each in POSE_HOUSEKEEPING)
    if not (isinstance(position_m, float) and isinstance(heading_rad, float)):
        return Uncertainty()
    return Uncertainty(position_m, heading_rad)


def _why(faults: FaultStatus) -> tuple[str, ...]:
    """Return why the rover stands, or what moves it, and its faults, a line for each."""
    return (faults.why, *(_fault_line(each, faults.why) for each in faults.active))


def _fault_line(fault: ActiveFault, why: str) -> str:
    """Return a fault: how bad, since when, what is done about it, and what showed it.

    Its evidence is left out where the line on why the rover stands has it.
    """
    until = "until a resume" if fault.onResume else "while it shows"
    done = f"{fault.reaction.name.lower()} {until}"
    evidence = "" if fault.text in why else f": {fault.text}"
    return f"{fault.severity.name} {fault.name} since {utc(fault.began)} UTC, {done}{evidence}"


def _not_monitored(faults: FaultStatus | None) -> str:
    """Return in a line what is not monitored, by why."""
    if faults is None:
        return "its faults are not told here, but as events"
    return f"not monitored: {summary(faults.unmonitored)}"


def _ways_out(
    mode: AssetMode, suspended: tuple[PlanUpdate, ...], faults: FaultStatus | None
) -> tuple[str, ...]:
    """Return how a rover that stands goes on, and what its plans wait for; nothing if it does."""
    lines: list[str] = []
    holding = [each for each in faults.active if each.reaction in _HOLDING] if faults else []
    if holding:
        if any(each.onResume for each in holding):
            lines.append(f"to go on, when that is over: {_RESUME}")
    elif mode is AssetMode.STOPPED:
        lines.append(f"to go on: {_RESUME}")
    elif mode is AssetMode.SAFE:
        where = "" if faults else "rover watch says why; "
        lines.append(f"{where}to go on, when that is over: {_RESUME}")
    for plan in suspended:
        lines.append(f"plan {plan.planId} is suspended: {plan.text}")
        lines.append(f"to go on: rover plan resume {plan.planId}")
    return tuple(lines)


async def _show_assets(to: RoverTarget, as_json: bool) -> None:
    """Print the rover and all others that it heard of, with their modes."""
    async with await connect(to) as client:
        assets = await client.list_assets()
    if as_json:
        for each in assets:
            echo_json({"asset": each.asset, "mode": each.mode})
        return
    rows = ((each.asset, each.mode.name, each.softwareVersion, each.description) for each in assets)
    print_table(rows, "asset", "mode", "software", "what it is")


async def _show_asset(to: RoverTarget, asset: str, as_json: bool) -> None:
    """Print the values that the rover last heard of another.

    Raises:
        click.UsageError: it heard of no such asset.
    """
    async with await connect(to) as client:
        try:
            values = await client.get_asset_value(asset)
        except MalError as error:
            if error.number != AreaError.NOT_FOUND.value:
                raise
            text = f"--asset: {asset} was not heard of; `rover status --assets` lists who was"
            raise click.UsageError(text) from error
        units = {each.name: each.unit or "" for each in await client.list_definition()}
    if as_json:
        found = {
            each.name: {"value": _figure(each), "time": iso(each.timestamp)} for each in values
        }
        echo_json({"asset": asset, "parameters": found})
        return
    rows = (
        (each.name, _shown(_figure(each)), units.get(each.name, ""), iso(each.timestamp))
        for each in values
    )
    print_table(rows, "parameter", "value", "unit", "sampled, UTC")


def _figure(value: ParameterValue) -> float | str | None:
    if value.value is None:
        return None
    found = value.value.value
    return found if isinstance(found, str) else float(found)


def _shown(figure: float | str | None) -> str:
    match figure:
        case None:
            return "not known"
        case str():
            return printable(figure)
        case _:
            return f"{figure:z.3f}"


@click.command()
@in_session
async def services(client: MrsClient) -> None:
    """List the services of a rover: operations, provider and broker of each.

    The directory is all that a client has to be told of: it finds the rest by what stands here.
    Services of other assets that registered here are named ASSET.SERVICE.

    \b
    Examples:
      rover services
      rover services --to rover.local:21000
    """
    asset, found = await client.get_asset(), await client.get_services()
    say(f"{asset.asset}  {asset.mode.name}")
    say(asset.description)
    say(f"domain {'.'.join(asset.domain)}, software {asset.softwareVersion}")
    click.echo()
    for provider in dict.fromkeys(each.providerURI for each in found):
        say(provider)
        rows = (
            (each.name, "; ".join(filter(None, (", ".join(_operations(each)), each.brokerURI))))
            for each in found
            if each.providerURI == provider
        )
        print_table(rows, "service", "operations; broker")


def _operations(descriptor: ServiceDescriptor) -> list[str]:
    """Return the operations by name, those that the interface does not know by number."""
    service = find_service(descriptor.service)
    names = {each.number: each.name for each in service.operations} if service else {}
    return [names.get(number, str(number)) for number in descriptor.operations]
