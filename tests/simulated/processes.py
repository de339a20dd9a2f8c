"""The processes of the project in a simulated world: orbiter, relay, executive."""

import asyncio
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from functools import partial
from typing import Final, Protocol

from adapters.bundle import ContactPlan, Peer, load_contact_plan
from adapters.mops import MopsError, load_dictionary
from adapters.mrs.link import MrsLink
from adapters.mrs.transport import CLEAR
from adapters.relay.orbiter import OrbiterSettings, RelayedRoverSettings
from adapters.relay.orbiter.relay import run
from adapters.relay.rover import RelaySettings
from adapters.relay.rover.bridge import BundleBridge
from adapters.relay.rover.executive_link import POLL_S, ExecutiveRelayLink
from executive.core.runner import Executive
from executive.record import Ledger
from executive.settings import Settings
from executive.values.facts import Battery, Fact, Odometry
from executive.values.ports import Downlink, VelocityRover
from tests.simulated.convergence import Convergence, Links, link_to, listen
from tests.simulated.process import Process
from tests.simulated.stop_watch import StopWatch
from tests.simulated.system import SimSystem
from trees import RoverTree

TICK_S: Final = 0.05
REST_S: Final = 1.0
"""Between two ticks while nothing is commanded, where nothing is watched more closely."""
CMD_VEL_TIMEOUT_S: Final = 0.5
"""After which the base stands if it receives no more velocities."""
MRS_PORT: Final = 20_000
_CONTACTS: Final = "contacts.ionrc"
DICTIONARY: Final = load_dictionary()


@dataclass(frozen=True, slots=True)
class Address:
    """One rover and what it has above it.

    Attributes:
        asset: its name.
        node: its number in the Bundle Protocol.
        orbiter, relay, executive: addresses of the computers.
        port: at which the orbiter serves the MRS for it.
        suffix: of the names of its processes.
        retransmit_after_s: see `OrbiterSettings`.
        answer_s: see `LtpLink`.
        convergence: by which layer bundles go.
        contacts: contact plan of both ends; None for permanent contact.
    """

    asset: str = "jackal"
    node: int = 2
    orbiter: str = "10.0.0.1"
    relay: str = "10.0.0.2"
    executive: str = "10.0.0.3"
    port: int = MRS_PORT
    suffix: str = ""
    retransmit_after_s: float | None = 120.0
    answer_s: float = 0.5
    convergence: Convergence = Convergence.LTP
    contacts: str | None = None

    def _link(self, host: str, *, dials: bool = False) -> Links:
        return link_to(self.convergence, host, self.answer_s, dials=dials)

    def relayed(self) -> RelayedRoverSettings:
        """Return the settings of the rover for `rover-mops`."""
        return RelayedRoverSettings(
            asset=self.asset,
            description=f"{self.asset} through the relay",
            domain=("meteron", self.asset),
            eid=f"ipn:{self.node}.1",
            port=self.port,
            **self._link(self.relay),
        )

    def relay_settings(self) -> RelaySettings:
        """Return the settings of `rover-relay`."""
        return RelaySettings(
            asset=self.asset.upper(),
            eid=f"ipn:{self.node}.1",
            orbiter=Peer(eid="ipn:1.1", **self._link(self.orbiter, dials=True)),
            listen=listen(self.convergence),
            contact_plan=None if self.contacts is None else _CONTACTS,
        )

    def contact_plan(self, process: Process) -> ContactPlan | None:
        """Return the contact plan of the rover's end, read as `rover-relay` does."""
        self.write_contacts(process)
        settings, file = self.relay_settings(), process.folder / "relay.yaml"
        return load_contact_plan(
            file, settings.contact_plan, process.folder, settings.node(), SimSystem(process)
        )

    def write_contacts(self, process: Process) -> None:
        """Write the file of planned contacts beside the settings of a process, if there are any."""
        if self.contacts is not None:
            (process.folder / _CONTACTS).write_text(self.contacts)


def orbiter_settings(addresses: Sequence[Address]) -> OrbiterSettings:
    """Return the settings of `rover-mops` with rovers behind it."""
    first = addresses[0]
    return OrbiterSettings(
        eid="ipn:1.1",
        listen=listen(first.convergence),
        rovers=tuple(address.relayed() for address in addresses),
        retransmit_after_s=first.retransmit_after_s,
        contact_plan=None if first.contacts is None else _CONTACTS,
    )


def start_orbiter(addresses: Sequence[Address], process: Process) -> None:
    """Start `rover-mops`."""
    settings_file = process.folder / "orbiter.yaml"
    addresses[0].write_contacts(process)
    process.run(
        run(
            orbiter_settings(addresses),
            settings_file,
            "0.0.0.0",
            process.folder,
            True,
            CLEAR,
            asyncio.Event(),
            SimSystem(process),
        )
    )


class BridgeTopics:
    """The ROS topics of `rover-relay`; its `RoverTopics`."""

    def __init__(self, process: Process, asset: str) -> None:
        self._topics = process.world.topics
        self._process, self._asset = process, asset
        self._loop = process.present.new_loop()
        self._commands = {
            stops: self._topics.publisher(process, f"{asset}/{'stop' if stops else 'command'}")
            for stops in (True, False)
        }
        self._stored = self._topics.publisher(process, f"{asset}/kept")

    def serve(self, bridge: BundleBridge) -> None:
        """Hand reports and confirmations to the bridge."""
        for name, callback in (("notification", bridge.notify), ("taken", bridge.on_confirmed)):
            self._topics.subscribe(self._process, f"{self._asset}/{name}", callback, self._loop)

    def publish(self, text: str, *, stops: bool) -> None:
        self._commands[stops].publish(text)

    def has_listener(self, *, stops: bool) -> bool:
        return self._commands[stops].subscriber_count > 0

    def confirm(self, mark: int) -> None:
        self._stored.publish(mark)


def start_relay(address: Address, process: Process) -> None:
    """Start `rover-relay`."""
    topics = BridgeTopics(process, address.asset)
    bridge = BundleBridge(
        address.relay_settings(),
        process.folder / "relay.sqlite",
        address.contact_plan(process),
        DICTIONARY,
        topics,
        system=SimSystem(process),
    )
    topics.serve(bridge)
    process.run(bridge.serve(Future()))


class ExecutiveTopics:
    """The ROS topics of the executive's end of the relay link; its `RelayTopics`."""

    def __init__(self, process: Process, asset: str) -> None:
        self._topics = process.world.topics
        self._process, self._asset = process, asset
        self._stops_loop = process.present.new_loop()
        self._reports = self._topics.publisher(process, f"{asset}/notification")
        self._taken = self._topics.publisher(process, f"{asset}/taken")

    def serve(self, link: ExecutiveRelayLink) -> None:
        """Hand commands and confirmations to the link; stops on a thread apart."""

        def command(text: str) -> None:
            try:
                link.command(text)
            except MopsError as error:
                self._process.world.note(f"{self._process.name}: {error}")

        subscribe = partial(self._topics.subscribe, self._process)
        subscribe(f"{self._asset}/stop", command, self._stops_loop)
        subscribe(f"{self._asset}/command", command)
        subscribe(f"{self._asset}/kept", link.on_confirmed)

    def publish(self, text: str) -> None:
        self._reports.publish(text)

    def confirm(self, mark: int) -> None:
        self._taken.publish(mark)

    def count_listeners(self) -> int:
        return self._reports.subscriber_count


class Below(Protocol):
    """A rover, which moves on while no executive runs: until its base gets no more velocities."""

    @property
    def rover(self) -> VelocityRover:
        """What executives command."""
        ...

    @property
    def downlinks(self) -> Sequence[Downlink]:
        """What else is given the reports."""
        ...

    @property
    def rest_s(self) -> float:
        """How long its executives rest between two ticks while nothing is commanded."""
        ...

    def begin(self, last_sequence: int) -> None:
        """Get another executive, after a report with a number."""

    def sense(self, now_s: float) -> Iterable[Fact]:
        """Move until now, and return what was sensed."""
        ...


@dataclass
class RoverBelow:
    """A kinematic one."""

    rover: StopWatch = field(default_factory=StopWatch)
    at_s: float = 0.0
    rest_s: float = REST_S

    @property
    def downlinks(self) -> Sequence[Downlink]:
        return (self.rover,)

    def begin(self, last_sequence: int) -> None:
        self.rover.sent.clear()
        self.rover.begin(last_sequence)

    def advance(self, now_s: float, fresh: bool) -> None:
        """Move until now."""
        step_s, self.at_s = now_s - self.at_s, now_s
        self.rover.advance(step_s if fresh else min(step_s, CMD_VEL_TIMEOUT_S))

    def sense(self, now_s: float) -> Iterable[Fact]:
        self.advance(now_s, fresh=True)
        rover = self.rover
        return Odometry(now_s, rover.pose, rover.velocity), Battery(26.0), rover.angles


def start_executive(
    address: Address, below: Below, settings: Settings, process: Process, *, is_direct: bool = True
) -> None:
    """Start `rover-executive --relay` over a rover, without a direct link unless `is_direct`."""
    system = SimSystem(process)
    ledger = Ledger(process.folder / "ledger.sqlite", connect=system.connect)
    topics = ExecutiveTopics(process, address.asset)
    relay = ExecutiveRelayLink(topics, ledger, DICTIONARY, address.asset.upper(), system)
    direct = MrsLink(settings, "0.0.0.0", MRS_PORT, clear_text=True, system=system)
    below.begin(ledger.last_sequence)
    executive = Executive(
        settings=settings,
        clock=system,
        rover=below.rover,
        ledger=ledger,
        files=process.folder / "files",
        downlinks=[*([direct] if is_direct else []), relay, *below.downlinks],
        build_tree=RoverTree,
    )
    relay.serve(executive.submit, lambda: executive.mode)
    topics.serve(relay)
    if is_direct:
        link_loop = process.present.new_loop()
        link_loop.call_soon(lambda: link_loop.create_task(direct.serve(executive, Future())))

    def sense(now_s: float) -> None:
        for fact in below.sense(now_s):
            executive.observe(fact)

    process.run(tick(executive, sense, relay.poll, lambda: below.rest_s))


async def tick(
    executive: Executive,
    sense: Callable[[float], None],
    poll: Callable[[], None],
    rest_s: Callable[[], float] = lambda: REST_S,
) -> None:
    """Run an executive for ever.

    Args:
        executive: that is run.
        sense: called before each tick, with the time.
        poll: called every `POLL_S`, at ticks.
        rest_s: returns the time between two ticks while nothing is commanded.
    """
    loop, woken = asyncio.get_running_loop(), asyncio.Event()

    def wake() -> None:
        loop.call_soon_threadsafe(woken.set)

    executive.wake = wake
    polled_s = loop.time()
    while True:
        now_s = loop.time()
        sense(now_s)
        executive.tick()
        if now_s - polled_s >= POLL_S:
            polled_s = now_s
            poll()
        busy = executive.active_command is not None or executive.waiting > 0
        next_s = now_s + (TICK_S if busy else rest_s())
        while (left_s := next_s - loop.time()) > 0.0:
            try:
                async with asyncio.timeout(left_s):
                    await woken.wait()
            except TimeoutError:
                break
            woken.clear()
            executive.serve_inbox()
            next_s = min(next_s, loop.time() + TICK_S)
