"""The simulated Jackal behind the relay: scenarios by the relay in simulated time."""

import asyncio
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Final, Self

from adapters.mrs.ground import MrsClient
from executive.values.facts import Fact
from executive.values.parameters import Parameter
from executive.values.ports import Downlink
from sim.rover.camera import PictureSettings
from sim.rover.jackal import SimulatedJackal
from sim.scenario.live_session import LiveSession
from sim.scenario.model import Outage, RunMode, Scenario
from sim.scenario.record import Record, TruePose
from sim.scenario.truth import load_requests
from tests.simulated.network import Channel
from tests.simulated.process import Process, Start
from tests.simulated.processes import (
    MRS_PORT,
    TICK_S,
    Address,
    start_executive,
    start_orbiter,
    start_relay,
)
from tests.simulated.system import SimSystem
from tests.simulated.world import World

START_S: Final = 20.0
"""When a scenario starts: all is connected by then."""
_STEP_S: Final = 0.01
_POLL_S: Final = 0.1
_DOWN_S: Final = 1.0
_GROUND: Final = "10.0.1.1"


class JackalBelow:
    """A Jackal that stands in a world of MuJoCo and has its sensors; a `Below`.

    Attributes:
        poses: the true ones, with the times of the scenario.
    """

    rest_s = TICK_S
    downlinks: Sequence[Downlink] = ()

    def __init__(self, world: World, scenario: Scenario) -> None:
        settings, camera = scenario.settings, scenario.settings.camera
        picture = PictureSettings(camera.width_px, camera.height_px)
        self.rover = SimulatedJackal(
            scenario.world,
            scenario.seed,
            scenario.odometry,
            picture,
            settings.sensors,
            settings.mux,
        )
        self.poses: list[TruePose] = []
        self._world, self._facts = world, list[Fact]()
        world.after(_STEP_S, self._step)

    def begin(self, last_sequence: int) -> None:
        """Forget what nobody received."""
        self._facts.clear()

    def sense(self, now_s: float) -> Iterable[Fact]:
        """Return what was sensed since the last call."""
        facts, self._facts = self._facts, []
        return facts

    def _step(self) -> None:
        self.rover.advance(_STEP_S)
        self._facts += self.rover.facts()
        if (scenario_s := self._world.now_s - START_S) >= 0.0:
            self.poses.append(TruePose(scenario_s, self.rover.true_pose))
        self._world.after(_STEP_S, self._step)


class RelayScene:
    """A context: ground, orbiter, `rover-relay` and an executive over a Jackal, in simulated time.

    Args:
        scenario: what is played.
        folder: gets the folders of the processes; empty.
        channel: between orbiter and rover.
        seed: of what the network draws.

    Attributes:
        world: whose processes may be killed.
        record: what was seen, after `play`.
    """

    def __init__(self, scenario: Scenario, folder: Path, channel: Channel, seed: int) -> None:
        self.scenario = scenario
        self.world = world = World(seed, folder)
        address = Address(retransmit_after_s=None)
        self._below = JackalBelow(world, scenario)
        starts: dict[str, tuple[str, Start]] = {
            "orbiter": (address.orbiter, partial(start_orbiter, (address,))),
            "relay": (address.relay, partial(start_relay, address)),
            "executive": (
                address.executive,
                partial(start_executive, address, self._below, scenario.settings),
            ),
            "ground": (_GROUND, self._start_ground),
        }
        for name, (host, start) in starts.items():
            world.process(name, host, start)
        for one, other in ((address.orbiter, address.relay), (address.relay, address.orbiter)):
            world.network.set_channel(one, other, channel)
        aboard = world.processes["executive"].folder
        self._uri = f"maltcp://{address.orbiter}:{MRS_PORT}/MRS"
        self.record = Record(world.start_utc_s + START_S, aboard / "files")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.world.close()

    def kill(self, name: str, at_s: float) -> None:
        """Have a process killed, and started again a second later."""
        process = self.world.processes[name]
        self.world.at(at_s, process.kill)
        self.world.at(at_s + _DOWN_S, process.begin)

    def play(self) -> Record:
        """Play to the end of the scenario, and return what was seen."""
        world, record = self.world, self.record
        for process in world.processes.values():
            process.begin()
        world.run(START_S + self.scenario.duration_s + _DOWN_S)
        assert world.errors == []
        self._poll()
        load_requests(record, world.processes["executive"].folder / "ledger.sqlite")
        return record

    def _start_ground(self, process: Process) -> None:
        process.run(self._ground(process, SimSystem(process)))

    async def _ground(self, process: Process, system: SimSystem) -> None:
        await self._located(system)
        left_s = START_S - process.loop.time()
        assert left_s > 0.0, "it is not known in time where the rover is"
        await asyncio.sleep(left_s)
        mode, record = RunMode.RELAY, self.record
        session = LiveSession(
            self.scenario,
            {mode.link: self._uri},
            mode,
            None,
            None,
            self._poll,
            record,
            system=system,
        )
        await session.play()

    def _poll(self) -> None:
        self.record.poses = self._below.poses

    async def _located(self, system: SimSystem) -> None:
        needed = Parameter.POS_X.value, Parameter.CAM_PAN.value
        async with await MrsClient.connect(self._uri, system=system) as client:
            while any(value.value is None for value in await client.get_value(*needed)):
                await asyncio.sleep(_POLL_S)


def channel_of(scenario: Scenario, delay_s: float, loss: float = 0.0) -> Channel:
    """Return the way between orbiter and rover, with the eclipses of a scenario.

    Args:
        delay_s: the time of light.
        loss: the part of datagrams that is lost.
    """
    dark = [
        (START_S + entry.at_s, START_S + entry.at_s + entry.outage_s)
        for entry in scenario.timeline
        if isinstance(entry, Outage) and entry.at_s is not None
    ]
    return Channel(delay_s, loss=loss, open=lambda now_s: not any(a <= now_s < b for a, b in dark))
