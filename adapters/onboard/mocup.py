"""`MocupOnRos`: MOCUP's MOPS messages on two ROS topics; its camera is that of any rover."""

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Final

from rclpy.duration import Duration
from rclpy.node import Node
from std_msgs.msg import String, UInt64

from adapters.mocup import ClaimAnnouncer, MocupFact, MocupRover, relay_authority
from adapters.mops import (
    Housekeeping,
    Message,
    MopsError,
    decode,
    housekeeping_of,
    load_dictionary,
)
from adapters.ros import (
    MessageError,
    RosFrames,
    Subscribe,
    Topics,
    declare_topic,
    publish_heartbeat,
)
from executive.core.authority import AuthorityRecord
from executive.record import Ledger, LedgerError
from executive.settings import Settings
from executive.values.clock import Clock
from executive.values.facts import Fact
from executive.values.ports import CameraIntent, DelegatedMotion, Downlink

SOURCE: Final = "EXEC"
REMIND_S: Final = 0.5
HOUSEKEEPING_TIMEOUT_S: Final = 15.0
"""Timeout of the housekeeping of `rover-nxt`, which is sent every 5 s."""
REPLAYED_REPORTS: Final = 200
"""Number of reports searched for those that `rover-nxt` needs after a reconnect."""


class MocupOnRos(RosFrames):
    """Publishes commands for the brick, and processes its replies, on the executor's thread."""

    def __init__(self, node: Node, topics: Topics, clock: Clock, settings: Settings) -> None:
        """Create the publisher.

        Args:
            node: declares and creates topics.
            topics: topics of every rover.
            clock: the core's clock.
            settings: settings of the asset, which give the name of the brick.

        Raises:
            executive.settings.SettingsError: the MOPS dictionary is invalid.
            adapters.ros.parameters.ParameterError: a topic is missing.
        """
        super().__init__(node, topics.camera)
        command = declare_topic(node, "mops_command", "MOPS commands to the brick", String)
        self._replies = declare_topic(
            node, "mops_notification", "MOPS replies of the brick", String
        )
        self._taken = declare_topic(
            node, "mops_command_ack", "fingerprint of a string accepted by rover-nxt", UInt64
        )
        self._commands = node.create_publisher(String, command.name, command.qos)
        publish_heartbeat(node, command)
        self._observe: Callable[[Fact], None] = lambda _: None
        self._brick, self._dictionary = settings.asset.upper(), load_dictionary()
        self._authority = settings.authority
        self._rover = MocupRover(
            self._dictionary, clock, self._send, self._observe_fact, SOURCE, self._brick
        )
        self._claims: ClaimAnnouncer | None = None
        self._resend_claims: Callable[[], None] = lambda: None
        self._last_housekeeping: Housekeeping | None = None
        self._listeners = 0
        node.create_timer(REMIND_S, self._poll)

    def subscribe(self, add_subscription: Subscribe, observe: Callable[[Fact], None]) -> None:
        """Subscribe to the brick's replies."""
        self._observe = observe
        add_subscription(self._replies, self._on_reply)
        add_subscription(self._taken, self._on_taken)

    def downlinks(self, ledger: Ledger) -> Sequence[Downlink]:
        """Return the downlink that sends `rover-nxt` commands, their reports and the authority.

        Messages missed during an absence of either process are sent again when both are connected.
        """
        grants = AuthorityRecord(ledger)
        claims = ClaimAnnouncer(
            self._dictionary,
            ledger.request,
            lambda: relay_authority(self._authority, grants.read()),
            self._publish,
            SOURCE,
            self._brick,
        )

        def again() -> None:
            with suppress(LedgerError):  # the core detects and reports that too
                claims.resend(ledger.reports(ledger.last_sequence - REPLAYED_REPORTS + 1))

        self._claims, self._resend_claims = claims, again
        return (claims,)

    def execute_motion(self, motion: DelegatedMotion) -> None:
        """Have the brick execute a motion."""
        self._rover.execute_motion(motion)

    def halt(self) -> None:
        """Stop the brick."""
        self._rover.halt()

    def emergency_stop(self) -> None:
        """Stop the brick, from any thread."""
        self._rover.emergency_stop()

    def point_camera(self, wanted: CameraIntent) -> None:
        """Point the camera."""
        self._rover.point_camera(wanted)

    def stop(self) -> None:
        """Stop the brick's motion for the executive; a motion for the relay continues."""
        if self._rover.moving:
            self.halt()

    def flush(self, timeout_s: float) -> bool:
        """Wait until the last command has been received; return whether it was."""
        return self._commands.wait_for_all_acked(Duration(seconds=timeout_s))

    def housekeeping(self) -> Mapping[str, float | None]:
        """Return the last housekeeping of `rover-nxt`; empty after a timeout."""
        last = self._last_housekeeping
        return (
            {}
            if last is None or time.time() - last.utc_s > HOUSEKEEPING_TIMEOUT_S
            else last.figures
        )

    def _poll(self) -> None:
        listeners = self._commands.get_subscription_count()
        if listeners > self._listeners:
            self._resend_claims()
        self._listeners = listeners
        if self._claims is not None and listeners:
            self._claims.poll()
        self._rover.retransmit()

    def _send(self, message: Message) -> None:
        self._publish(str(message))

    def _publish(self, text: str) -> None:
        self._commands.publish(String(data=text))

    def _on_taken(self, mark: UInt64) -> None:
        if self._claims is not None:
            self._claims.on_acknowledged(mark.data)

    def _observe_fact(self, fact: MocupFact) -> None:
        self._observe(fact)

    def _on_reply(self, text: String) -> None:
        try:
            message, entry = decode(text.data.encode()), self._dictionary.spelling.housekeeping
            if message.code == entry.code:
                self._last_housekeeping = housekeeping_of(message, entry)
            else:
                self._rover.on_reply(message)
        except MopsError as fault:
            raise MessageError(f"no MOPS reply: {fault}") from fault
