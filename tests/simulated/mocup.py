"""MOCUP's processes in a simulated world: `rover-nxt` between both links and the brick."""

import asyncio
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

from adapters.mocup import ClaimAnnouncer, MocupRover, relay_authority
from adapters.mocup.brick.ownership import HEARTBEAT_TIMEOUT_S
from adapters.mocup.brick.record import BrickLink, BrickRecord
from adapters.mocup.brick.router import Router
from adapters.mocup.brick.service import BrickService, DurableOutput
from adapters.mops import Message, RelayAuthority, decode, facts_of
from adapters.mrs.link import MrsLink
from adapters.relay.orbiter import RelayedRoverSettings
from adapters.ros import HeartbeatMonitor
from executive.core.authority import AuthorityRecord
from executive.core.runner import Executive
from executive.record import Ledger, LedgerError
from executive.settings import Settings
from executive.values.facts import Fact
from tests.simulated.brick import DICTIONARY, NAME, SimBrick, SimSession
from tests.simulated.process import Process
from tests.simulated.processes import MRS_PORT, Address, tick
from tests.simulated.system import SimSystem
from trees import RoverTree

RELAY_TELEMETRY_S: Final = 5.0
_HEARTBEAT_S, _POLL_S = 0.1, 1.0
OPERATIONS: Final = (
    "MotionControl.moveForward",
    "MotionControl.rotateBy",
    "MotionControl.stop",
    "MotionControl.setTravelSpeed",
    "MotionControl.setRotateSpeed",
    "Camera.setAngles",
)
_SOURCE: Final = "EXEC"
_CLAIMED_AGAIN: Final = 200
COMMANDERS: Final = {BrickLink.RELAY: "relay", BrickLink.DIRECT: "executive"}
"""The processes that send by each link."""


@dataclass(frozen=True, slots=True)
class MocupAddress(Address):
    """MOCUP, whose commands of the relay go to `rover-nxt`."""

    asset: str = NAME.lower()
    node: int = 3

    def relayed(self) -> RelayedRoverSettings:
        """Return the settings of the rover for `rover-mops`: a brick numbers no reports."""
        return replace(Address.relayed(self), numbers_reports=False, operations=OPERATIONS)


class NxtPorts:
    """The topics of `rover-nxt` and its session; the router's `RouterPorts`.

    The heartbeats of both links are looked up at their processes.
    """

    def __init__(self, address: Address, brick: SimBrick, process: Process) -> None:
        self._process, self._system = process, SimSystem(process)
        topics, asset = process.world.topics, address.asset
        self._names = {BrickLink.RELAY: asset, BrickLink.DIRECT: f"{asset}/direct"}
        self._notifications = {
            link: topics.publisher(process, f"{name}/notification")
            for link, name in self._names.items()
        }
        self._taken = {
            link: topics.publisher(process, f"{name}/taken") for link, name in self._names.items()
        }
        self._facts = topics.publisher(process, f"{asset}/facts")
        self._telemetry_s = 0.0
        record = self._record = BrickRecord(process.folder / "nxt.sqlite", self._system)
        refuse = partial(self._note, "refuses")
        stop = DICTIONARY.spelling.commands["stop"]
        self._output = DurableOutput(record, stop, self._put, self._start_sync, refuse)
        free = RelayAuthority(needed=False)
        self._router = Router(DICTIONARY, NAME, self, refuse, record, free, self._system)
        self._service = BrickService(self._router, self._output.put, confirmed=True)
        self._session = SimSession(process, brick, self._drain)
        self._commanders = {
            link: HeartbeatMonitor(HEARTBEAT_TIMEOUT_S, partial(self._router.on_host_silent, link))
            for link in BrickLink
        }
        subscribe = partial(topics.subscribe, process)
        for link, name in self._names.items():
            subscribe(f"{name}/command", partial(self._arrived, link))
        subscribe(f"{asset}/stop", partial(self._arrived, BrickLink.RELAY))
        subscribe(f"{asset}/kept", self._service.on_confirmed)

    async def serve(self) -> None:
        """Serve for ever."""
        self._session.start()
        loop = asyncio.get_running_loop()
        polled_s = loop.time()
        while True:
            await asyncio.sleep(_HEARTBEAT_S)
            for link, monitor in self._commanders.items():
                sender = self._process.world.processes.get(COMMANDERS[link])
                if sender is not None and sender.alive and not sender.paused:
                    monitor.heartbeat(sender.present.number)
                monitor.update()
            if loop.time() - polled_s >= _POLL_S:
                polled_s = loop.time()
                self._service.poll({link: p.subscribers for link, p in self._notifications.items()})
                self._output.sync()

    def to_brick(self, octets: bytes, visit: int) -> bool:
        self._output.sync()
        return self._session.send(octets, visit, self._record.sealed)

    def stop_brick(self, octets: bytes) -> bool:
        return self._session.stop(octets)

    def notify(self, link: BrickLink, message: Message) -> None:
        self._output.put(link, message)

    def publish_telemetry(self, message: Message) -> None:
        now_s = self._system.now_s()
        if now_s - self._telemetry_s >= RELAY_TELEMETRY_S:
            self._telemetry_s = now_s
            self._put(BrickLink.RELAY, message)
        for fact in facts_of(message, DICTIONARY.spelling.telemetry, now_s):
            self._facts.publish(fact)

    def _arrived(self, link: BrickLink, text: str) -> None:
        self._service.inbox.put(link, text)
        self._process.loop.call_soon(self._serve_inbox)

    def _serve_inbox(self) -> None:
        if (link := self._service.serve()) is not None:
            self._commanders[link].command()

    def _put(self, link: BrickLink, output: Message | int) -> None:
        if isinstance(output, int):
            self._taken[link].publish(output)
        else:
            self._notifications[link].publish(str(output))

    def _start_sync(self) -> None:
        synced = self._process.loop.run_in_executor(None, self._record.sync)
        synced.add_done_callback(self._on_synced)

    def _on_synced(self, sync: asyncio.Future[None]) -> None:
        self._session.release(self._record.durable)
        self._output.on_synced(sync.exception())

    def _drain(self) -> None:
        self._service.drain(self._session.events())

    def _note(self, does: str, line: str) -> None:
        self._process.world.note(f"{self._process.name} {does} {line}")


def start_nxt(address: Address, brick: SimBrick, process: Process) -> None:
    """Start `rover-nxt`."""
    process.run(NxtPorts(address, brick, process).serve())


class MocupTopics:
    """The topics of MOCUP's executive, as `adapters.onboard.mocup` has them.

    Its `DelegatedMotionRover`.
    """

    def __init__(
        self, address: Address, settings: Settings, ledger: Ledger, process: Process
    ) -> None:
        topics, name = process.world.topics, address.asset
        self._process, self._ledger, self._system = process, ledger, SimSystem(process)
        self._commands = topics.publisher(process, f"{name}/direct/command")
        self._listeners = 0
        self._facts: list[Fact] = []
        sends = (self._send, self._facts.append, _SOURCE, NAME)
        self._rover = MocupRover(DICTIONARY, self._system, *sends)
        grants = AuthorityRecord(ledger)
        self.claims = ClaimAnnouncer(
            DICTIONARY,
            ledger.request,
            lambda: relay_authority(settings.authority, grants.read()),
            self._commands.publish,
            _SOURCE,
            NAME,
        )
        self.execute_motion, self.halt = self._rover.execute_motion, self._rover.halt
        self.emergency_stop = self._rover.emergency_stop
        self.point_camera = self._rover.point_camera

    def serve(self, executive: Executive) -> None:
        """Hand facts and replies to an executive."""
        subscribe = partial(self._process.world.topics.subscribe, self._process)
        name = self._commands.name.rpartition("/")[0]

        def reply(text: str) -> None:
            message = decode(text.encode())
            if message.code != DICTIONARY.spelling.housekeeping.code:
                self._rover.on_reply(message)
            self.flush(executive)

        subscribe(f"{name}/notification", reply)
        subscribe(f"{name}/taken", self.claims.on_acknowledged)
        subscribe(f"{name.partition('/')[0]}/facts", executive.observe)

    def flush(self, executive: Executive) -> None:
        """Hand over what the plugin has observed."""
        while self._facts:
            executive.observe(self._facts.pop(0))

    def poll(self) -> None:
        """Remind the brick, and claim again where `rover-nxt` is new."""
        before, self._listeners = self._listeners, self._commands.subscriber_count
        if self._listeners > before:
            with suppress(LedgerError):
                first = self._ledger.last_sequence - _CLAIMED_AGAIN + 1
                self.claims.resend(self._ledger.reports(first))
        if self._listeners:
            self.claims.poll()
        self._rover.retransmit()

    def request_frame(self) -> None:
        """Do nothing: nothing is photographed."""

    def lock(self, held: bool) -> None:
        """Do nothing: there is no mux."""

    def _send(self, message: Message) -> None:
        self._commands.publish(str(message))


def start_mocup_executive(address: Address, settings: Settings, process: Process) -> None:
    """Start `rover-executive` over MOCUP, whose relay ends at `rover-nxt`."""
    system = SimSystem(process)
    ledger = Ledger(process.folder / "ledger.sqlite", connect=system.connect)
    rover = MocupTopics(address, settings, ledger, process)
    direct = MrsLink(settings, "0.0.0.0", MRS_PORT, clear_text=True, system=system)
    executive = Executive(
        settings=settings,
        clock=system,
        rover=rover,
        ledger=ledger,
        files=process.folder / "files",
        downlinks=[direct, rover.claims],
        build_tree=RoverTree,
    )
    rover.serve(executive)
    link_loop = process.present.new_loop()
    link_loop.call_soon(lambda: link_loop.create_task(direct.serve(executive, Future())))
    process.run(tick(executive, lambda _: rover.flush(executive), rover.poll))
