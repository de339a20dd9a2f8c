"""A day of operations that a seed draws, and its processes: ground, orbiter, relay, rover."""

import asyncio
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import partial
from itertools import pairwise
from math import atan2, cos, hypot, pi, sin
from pathlib import Path
from random import Random
from typing import Final, Self

from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import ReceivedValue
from executive.commands import (
    ActivatePlan,
    PlanDefinition,
    Request,
    SetCameraRotateSpeed,
    SubmitPlan,
)
from executive.faults import Reaction
from executive.settings import LaserSettings, Settings, load_settings
from executive.values.geometry import Pose
from executive.values.parameters import Parameter, ParameterValue
from executive.values.reports import FileEvent, PlanUpdate, Report
from sim.rover.faults import CameraDead, LaserDead, SimulatedFault
from sim.rover.features import GroundPoint, Wall
from sim.rover.world import Rock
from sim.rover.world import World as Terrain
from tests.simulated.network import Channel
from tests.simulated.process import Process
from tests.simulated.processes import (
    MRS_PORT,
    Address,
    start_executive,
    start_orbiter,
    start_relay,
)
from tests.simulated.resting import REST_S, RestingJackal
from tests.simulated.system import SimSystem
from tests.simulated.world import World
from tests.support.kinematic import with_figures
from tests.support.patience import UNTIMED

LEAD_S: Final = 60.0
"""How long all processes run before the day begins: all is connected by then."""
HOUR_S: Final = 3600.0
PASS_S: Final = 240.0
SHELTER_M: Final = 0.7
"""The rover is at home, sheltered from the cold, within this distance of it."""
PANORAMA: Final = (-1.2, -0.4, 0.4, 1.2)
_DAY_W, _COLD_W, _SHELTERED_W, _SUN_W = 30.0, 32.0, 14.0, 75.0
_MOE: Final = "10.0.1.1"
_IN_PASS_REST_S: Final = 4.0
_AWAKE_S: Final = 10.0
"""How long before the no-op, and after a pass, the processes of the link run; else they sleep."""
_LATE_S, _STALE_S = 30.0, 10.0
_OF_THE_LINK: Final = ("orbiter", "relay", "moe")


@dataclass(frozen=True, slots=True)
class Site:
    """A position to be photographed, in one of the stages of a day.

    Attributes:
        panorama: whether four directions are wanted, too.
        morning: whether it is for the morning after the night.
    """

    name: str
    x_m: float
    y_m: float
    panorama: bool = False
    morning: bool = False

    def distance_m(self, pose: Pose) -> float:
        """Return the distance of a pose."""
        return hypot(pose.x_m - self.x_m, pose.y_m - self.y_m)


@dataclass(frozen=True, slots=True)
class Pass:
    """A pass of the orbiter: planned times, and when the link is there; None if it is not.

    Attributes:
        opens_s: actual begin.
    """

    begin_s: float
    end_s: float
    opens_s: float | None


@dataclass(frozen=True, slots=True)
class Day:
    """What a day has; all times are from its begin.

    Attributes:
        sunset_s, sunrise_s: between them it is night.
        planned_end_s: the end of the day.
        rocks, walls: three obstacles in all, which nobody aboard knows.
        fault, near, fault_s: a fault that begins when the rover first comes within 2.5 m of a site.
        begin_utc_s: when it begins.
        hail_s: how long before a pass the ground has the orbiter store its no-op for the rover.
    """

    seed: int
    begin_utc_s: float
    sites: tuple[Site, ...]
    passes: tuple[Pass, ...]
    sunset_s: float
    sunrise_s: float
    end_s: float
    rocks: tuple[Rock, ...]
    walls: tuple[Wall, ...]
    fault: SimulatedFault
    near: Site
    fault_s: float
    charge_ratio: float = 0.28
    hail_s: float = 20.0

    @property
    def terrain(self) -> Terrain:
        """The ground with the obstacles."""
        return Terrain(
            name="day", rocks=self.rocks, walls=self.walls, charge_ratio=self.charge_ratio
        )

    def power_w(self, at_s: float, pose: Pose) -> float:
        """Return the power that the battery gains at a time of the day, in the sun or the cold."""
        if not self.sunset_s < at_s < self.sunrise_s:
            edge_s = self.sunset_s if at_s <= self.sunset_s else self.sunrise_s
            from_edge = abs(at_s - edge_s) / (self.sunrise_s - self.sunset_s)
            return _SUN_W * sin(pi * min(from_edge, 0.5)) - _DAY_W
        sheltered = hypot(pose.x_m, pose.y_m) <= SHELTER_M
        return -_SHELTERED_W if sheltered else -_COLD_W

    def open_at(self, at_s: float) -> bool:
        """Return whether the orbiter is in contact."""
        return any(
            each.opens_s is not None and each.opens_s <= at_s < each.end_s for each in self.passes
        )

    def contacts(self) -> str:
        """Return the contact plan in ION's syntax: the planned passes."""
        reference = datetime.fromtimestamp(self.begin_utc_s, UTC).strftime("%Y/%m/%d-%H:%M:%S")
        lines = [f"@ {reference}"]
        for each in self.passes:
            for ends in ("1 2", "2 1"):
                lines.append(f"a contact +{each.begin_s:.0f} +{each.end_s:.0f} {ends} 125000")
        lines.append(f"a range +0 +{self.end_s:.0f} 1 2 1")
        return "\n".join(lines) + "\n"


SITES: Final = (
    Site("A", 4.0, 0.0),
    Site("B", 5.0, 3.5, panorama=True),
    Site("C", 2.0, 5.0),
    Site("D", -2.0, 4.5),
    Site("E", -4.5, 2.0, panorama=True),
    Site("F", -4.0, -2.0),
    Site("G", 0.0, -5.0),
    Site("H", 3.0, -4.0, morning=True),
    Site("I", 5.0, -2.5, panorama=True, morning=True),
)
"""Those of `config/plans/day.xml`."""
BEGIN_UTC_S: Final = datetime(2026, 11, 27, 10, tzinfo=UTC).timestamp()


def draw_day(seed: int) -> Day:
    """Draw a day of 24 hours."""
    random = Random(f"day {seed}")
    passes = []
    missed = random.randrange(3, 12)
    for number in range(12):
        begin_s = number * 2 * HOUR_S
        opens_s = None if number == missed else begin_s + random.uniform(0.0, 30.0)
        passes.append(Pass(begin_s, begin_s + PASS_S, opens_s))
    rocks, walls = draw_obstacles(random, SITES)
    fault = (LaserDead(), LaserDead(), CameraDead())[random.randrange(3)]
    near = random.choice(SITES[1:6])
    return Day(
        seed, BEGIN_UTC_S, SITES, tuple(passes), 8 * HOUR_S, 20 * HOUR_S, 24 * HOUR_S,
        rocks, walls, fault, near, random.uniform(300.0, 900.0),
    )  # fmt: skip


def draw_obstacles(
    random: Random, sites: Sequence[Site]
) -> tuple[tuple[Rock, ...], tuple[Wall, ...]]:
    """Draw a rock on a site, a wall across a direct way, and a rock on another direct way."""
    covered = random.choice(sites)
    on_site = Rock(
        covered.x_m + random.uniform(-0.1, 0.1),
        covered.y_m + random.uniform(-0.1, 0.1),
        random.uniform(0.3, 0.45),
        0.6,
    )
    legs = [
        (one, other)
        for one, other in pairwise(sites)
        if hypot(one.x_m - other.x_m, one.y_m - other.y_m) > 2.9 and covered not in (one, other)
    ]
    first, second = random.sample(legs, 2)
    at, along_rad = _midway(*first)
    reach_m = random.uniform(0.8, 1.5)
    dx_m, dy_m = -reach_m * sin(along_rad), reach_m * cos(along_rad)
    wall = Wall(
        x_m=at[0] - dx_m, y_m=at[1] - dy_m, to=GroundPoint(at[0] + dx_m, at[1] + dy_m), height_m=0.6
    )
    at, _ = _midway(*second)
    on_path = Rock(*at, random.uniform(0.3, 0.6), 0.6)
    return (on_site, on_path), (wall,)


def _midway(one: Site, other: Site) -> tuple[tuple[float, float], float]:
    """Return the position midway between two sites, and the direction from one to the other."""
    middle = (one.x_m + other.x_m) / 2, (one.y_m + other.y_m) / 2
    return middle, atan2(other.y_m - one.y_m, other.x_m - one.x_m)


def day_settings() -> Settings:
    """Return a Jackal with a laser that waits for an obstacle, or for its laser, to be gone.

    Rows of faults that a rover shows only because its ticks are rare at rest are ignored.
    """
    settings = load_settings("jackal")
    faults = settings.faults
    untimed = ("odometry_lags_sensors", "odometry_late", "odometry_rate_low")
    silent = ("odometry_silent", "joints_silent", "imu_silent", "battery_silent")
    assert set(untimed) <= set(UNTIMED)
    rejected = tuple(f"{name}_rejected" for name in ("odometry", "imu", "joints", "laser"))
    rows = {
        name: replace(getattr(faults, name), reaction=Reaction.IGNORE)
        for name in (*untimed, *silent, *rejected)
    }
    rows["odometry_stale"] = with_figures(faults.odometry_stale, above=_STALE_S)
    for name in ("obstacle_ahead", "laser_silent"):
        rows[name] = replace(getattr(faults, name), reaction=Reaction.PAUSE)
    return replace(
        settings,
        status_interval_s=60.0,
        faults=replace(faults, **rows),
        sensors=replace(settings.sensors, imu=None, laser=LaserSettings(rate_hz=10.0)),
        safety=replace(settings.safety, watchdog_s=_LATE_S),
        camera=replace(settings.camera, width_px=64, height_px=48),
    )


class Witness:
    """A downlink that keeps all reports, to say why a goal was missed."""

    def __init__(self) -> None:
        self.reports: list[Report] = []
        self.plans: list[PlanUpdate] = []

    def send_reports(self, reports: Sequence[Report]) -> None:
        self.reports += reports

    def send_telemetry(self, values: Sequence[ParameterValue]) -> None:
        """Do nothing."""

    def send_file_event(self, event: FileEvent) -> None:
        """Do nothing."""

    def send_plan_update(self, update: PlanUpdate) -> None:
        self.plans.append(update)


@dataclass
class Received:
    """What the ground received over the relay, with the times of reception.

    Attributes:
        samples: times of sampling, and of reception, of the rover's position.
        events: texts of reports.
        ends: how commands of the ground ended.
    """

    samples: list[tuple[float, float]] = field(default_factory=list)
    events: list[tuple[float, str]] = field(default_factory=list)
    ends: list[str] = field(default_factory=list)


Conduct = Callable[[Process, "DayScene"], None]


class DayScene:
    """A context: the processes of a day, and what was observed of it.

    Args:
        day: the day.
        folder: gets the folders of the processes; empty.
        plan: uplinked in the first pass; None where `conduct` commands instead.
        conduct: a further process on the ground, with a direct link.
    """

    def __init__(
        self,
        day: Day,
        folder: Path | None,
        plan: PlanDefinition | None,
        conduct: Conduct | None = None,
    ) -> None:
        self.day, self._plan = day, plan
        self.world = world = World(day.seed, folder, start_utc_s=day.begin_utc_s - LEAD_S)
        address = Address(retransmit_after_s=None, answer_s=2.5, contacts=day.contacts())
        self.settings = day_settings()
        self.rover = RestingJackal(
            world,
            day.terrain,
            self.settings,
            day.seed,
            lambda now_s, pose: day.power_w(now_s - LEAD_S, pose),
        )
        self.witness, self.received = Witness(), Received()
        self.rover.downlinks = (self.witness,)
        self.rover.rest_s = _IN_PASS_REST_S
        self.rover.when(
            lambda pose: day.near.distance_m(pose) < 2.5,
            lambda: self._begin_fault(),
        )
        self.fault_ends_s: float | None = None
        world.process("orbiter", address.orbiter, partial(start_orbiter, (address,)))
        world.process("relay", address.relay, partial(start_relay, address))
        is_direct = conduct is not None
        start = partial(start_executive, address, self.rover, self.settings, is_direct=is_direct)
        world.process("executive", address.executive, start)
        world.process("moe", _MOE, self._start_ground)
        if conduct is not None:
            world.process("conduct", "10.0.1.9", lambda process: conduct(process, self))
        channel = Channel(1.0, loss=0.02, open=lambda now_s: day.open_at(now_s - LEAD_S))
        world.network.set_channel(address.orbiter, address.relay, channel)
        self._uri = f"maltcp://{address.orbiter}:{MRS_PORT}/MRS"
        self.direct_uri = f"maltcp://{address.executive}:{MRS_PORT}/MRS"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.world.close()

    @property
    def files(self) -> Path:
        """The folder of files aboard."""
        return self.world.processes["executive"].folder / "files"

    def play(self) -> None:
        """Play the day to its end."""
        for process in self.world.processes.values():
            process.begin()
        begin_s = 0.0
        for each in self.day.passes:
            for name in _OF_THE_LINK:
                process = self.world.processes[name]
                if begin_s:
                    self.world.at(begin_s, process.pause)
                    self.world.at(
                        LEAD_S + each.begin_s - self.day.hail_s - _AWAKE_S, process.resume
                    )
            if begin_s:
                self.world.at(begin_s, setattr, self.rover, "rest_s", REST_S)
                begins_s = LEAD_S + each.begin_s - self.day.hail_s - _AWAKE_S
                self.world.at(begins_s, setattr, self.rover, "rest_s", _IN_PASS_REST_S)
            begin_s = LEAD_S + each.end_s + _AWAKE_S
        self.world.run(LEAD_S + self.day.end_s)
        assert self.world.errors == [], self.world.errors

    def _begin_fault(self) -> None:
        day = self.day
        self.fault_ends_s = self.world.now_s - LEAD_S + day.fault_s
        self.rover.inject(day.fault, day.fault_s)

    def _start_ground(self, process: Process) -> None:
        process.run(self._ground(process))

    async def _ground(self, process: Process) -> None:
        """Uplink the plan in the first pass; in each pass send a no-op, and receive."""
        client = await connect(self._uri, process)
        reports, telemetry = client.notifications(), await client.telemetry()
        loop = asyncio.get_running_loop()

        async def receive() -> None:
            async for value in telemetry:
                self._sample(value, loop.time())

        async def listen() -> None:
            async for each in reports:
                self.received.events.append((loop.time() - LEAD_S, each.report.text))

        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(receive())
            tasks.create_task(listen())
            if self._plan is not None:
                for request in (SubmitPlan(self._plan), ActivatePlan(self._plan.plan_id)):
                    await self._command(client, request)
            speed = self.settings.camera.rotate_speed_radps
            for each in self.day.passes:
                left_s = LEAD_S + each.begin_s - self.day.hail_s - loop.time()
                if left_s > 0.0:
                    await asyncio.sleep(left_s)
                    tasks.create_task(self._command(client, SetCameraRotateSpeed(speed)))

    async def _command(self, client: MrsClient, request: Request) -> None:
        outcome = await client.run(client.command(request))
        self.received.ends.append(f"{type(request).__name__} {outcome}")

    def _sample(self, value: ReceivedValue, now_s: float) -> None:
        if value.name == Parameter.POS_X.value:
            at_s = value.utc_s - self.day.begin_utc_s
            self.received.samples.append((at_s, now_s - LEAD_S))


async def connect(uri: str, process: Process) -> MrsClient:
    """Return a client of a rover or an orbiter, as soon as it answers."""
    while True:
        with suppress(ConnectionError):
            return await MrsClient.connect(uri, "MOE", patience_s=1e9, system=SimSystem(process))
        await asyncio.sleep(1.0)
