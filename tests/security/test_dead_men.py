"""Whoever commands MOCUP is gone: it stands by itself. A stop acts whatever it carries."""

from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from threading import Event
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adapters.mocup.brick.ownership import HEARTBEAT_TIMEOUT_S
from adapters.mocup.brick.record import BrickLink
from adapters.mocup.brick.router import SOURCE
from adapters.mocup.brick.service import MAX_INBOX, StopFirstQueue
from adapters.mocup.brick.usb import Brick, BrickSession
from adapters.mops import Message, decode, encode
from adapters.ros import HeartbeatMonitor
from tests.brick.rig import DICTIONARY, Rig, command
from tests.mocup.brick.bus import ADDRESS
from tests.mocup.brick.routing import BOTH, Bench, claimed, executed, forward, part, stop
from tests.mocup.brick.test_usb import LIMIT_S
from tests.mocup.brick.test_usb import Bench as SessionBench
from tests.stress.dead_men import WATCHED_S, Target, kill_in_motion

CANCELLED = ("CANCELLED", "STOPPED", "stopped")


@pytest.fixture
def bench() -> Bench:
    return Bench()


def cancelled(requested: Message) -> Message:
    return replace(executed(requested), executed=False, outputs=CANCELLED)


def move(bench: Bench, link: BrickLink) -> Message:
    """Have the brick carry out a motion for a link, and return what it was asked."""
    requested = part(7, 1) if link is BrickLink.DIRECT else forward(8)
    bench.command(link, *([claimed(forward(7))] if link is BrickLink.DIRECT else []), requested)
    return requested


def sent(bench: Bench) -> list[Message]:
    return [decode(octets) for octets in bench.ports.brick]


@pytest.mark.parametrize(
    ("link", "source"), [(BrickLink.DIRECT, "the executive"), (BrickLink.RELAY, "rover-relay")]
)
def test_the_brick_is_stopped_when_its_commander_is_silent_and_the_reply_has_the_reason(
    bench: Bench, link: BrickLink, source: str
) -> None:
    requested = move(bench, link)
    bench.router.on_host_silent(link)
    assert sent(bench) == [requested, bench.halted()]
    bench.sends(cancelled(requested), executed(bench.halted()))
    ((reported_by, reported),) = bench.ports.notified
    assert reported_by is link
    assert reported.outputs == ("CANCELLED", "INTERRUPTED", f"no heartbeat of {source} for 0.5 s")
    assert bench.router.counts.dead_man == 1


@pytest.mark.parametrize("link", BOTH)
def test_a_client_that_moves_nothing_may_be_silent(bench: Bench, link: BrickLink) -> None:
    (other,) = set(BrickLink) - {link}
    bench.router.on_host_silent(link)
    requested = move(bench, other)
    bench.router.on_host_silent(link)
    assert sent(bench) == [requested]


def test_a_motion_requested_by_both_continues_until_both_are_silent(bench: Bench) -> None:
    for link in BOTH:
        bench.command(link, forward(7))
    bench.router.on_host_silent(BrickLink.DIRECT)
    assert sent(bench) == [forward(7)]
    bench.router.on_host_silent(BrickLink.RELAY)
    assert sent(bench) == [forward(7), bench.halted()]


def test_a_queued_command_of_a_closed_relay_is_not_begun(bench: Bench) -> None:
    move(bench, BrickLink.RELAY)
    bench.command(BrickLink.RELAY, forward(9))
    bench.router.on_host_silent(BrickLink.RELAY)
    bench.sends(cancelled(forward(8)), executed(bench.halted()))
    assert forward(9) not in sent(bench)
    ends = {m.moe_inputs_id: m.outputs[1] for _, m in bench.ports.notified if not m.executed}
    assert ends == {8: "INTERRUPTED", 9: "INTERRUPTED"}


def test_the_relay_continues_after_an_executive_that_has_ended(bench: Bench) -> None:
    requested = move(bench, BrickLink.DIRECT)
    bench.command(BrickLink.RELAY, forward(9))
    bench.router.on_host_silent(BrickLink.DIRECT)
    bench.sends(cancelled(requested))
    assert sent(bench)[-1].source == SOURCE, "not before the brick has answered the stop"
    bench.sends(executed(bench.halted()))
    assert sent(bench)[-1] == forward(9)


def test_on_a_full_disk_the_brick_is_stopped_all_the_same(bench: Bench) -> None:
    move(bench, BrickLink.DIRECT)
    bench.fill_disk(True)
    bench.router.on_host_silent(BrickLink.DIRECT)
    assert sent(bench)[-1] == bench.halted()


@pytest.mark.parametrize("link", BOTH)
@pytest.mark.parametrize(
    "wrong",
    [
        {"moe_inputs_id": None},
        {"moe_inputs_id": 0},
        {"moe_inputs_counter": 9},
        {"source": "MOCUP"},
        {"source": SOURCE},
        {"inputs": ("1.0", "now")},
    ],
)
def test_a_stop_acts_from_any_sender_under_any_number(
    bench: Bench, link: BrickLink, wrong: dict[str, object]
) -> None:
    move(bench, BrickLink.DIRECT)
    stops = replace(stop(7), **wrong)  # type: ignore[arg-type]
    for _ in range(3):
        bench.command(link, stops)
    assert sent(bench)[1:] == [replace(stops, inputs=())] * 3


def test_of_a_thousand_stops_under_the_same_numbers_a_thousand_act(bench: Bench) -> None:
    for number in range(1000):
        bench.command(BOTH[number % 2], stop(number % 3))
    assert len(bench.ports.brick) == 1000


@pytest.mark.at_length
@given(st.lists(st.booleans(), max_size=20))
def test_nothing_that_arrived_before_a_stop_is_taken_before_it_or_moves_after_it(
    stops: list[bool],
) -> None:
    bench = Bench()
    inbox = StopFirstQueue(bench.router.is_stop)
    for number, is_stop in enumerate(stops):
        inbox.put(BOTH[number % 2], str(stop(number) if is_stop else forward(number)))
    while arrived := inbox.take():
        bench.router.process(arrived.link, arrived.text, arrived.overtaken)
        for message in sent(bench):
            bench.sends(executed(message))
    last_stop = max((n for n, is_stop in enumerate(stops) if is_stop), default=-1)
    numbers = [message.moe_inputs_id for message in sent(bench)]
    assert sorted(n for n in numbers if n is not None and stops[n]) == [
        n for n, is_stop in enumerate(stops) if is_stop
    ]
    assert [n for n in numbers if n is not None and not stops[n]] == list(
        range(last_stop + 1, len(stops))
    )


def test_a_stop_has_capacity_when_too_many_messages_have_arrived(bench: Bench) -> None:
    inbox = StopFirstQueue(bench.router.is_stop)
    for number in range(MAX_INBOX):
        assert inbox.put(BrickLink.RELAY, str(forward(number)))
    assert not inbox.put(BrickLink.RELAY, str(forward(MAX_INBOX)))
    assert inbox.put(BrickLink.RELAY, str(stop(1)))
    first = inbox.take()
    assert first is not None
    assert first.text == str(stop(1))


@pytest.fixture
def session() -> Iterator[SessionBench]:
    bench = SessionBench()
    with closing(bench.session):
        yield bench


def test_a_stop_precedes_the_queue_for_the_brick_and_truncates_the_pending_write(
    session: SessionBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    held, take = Event(), session.bus.bulk_write

    def hold(*arguments: Any) -> int:
        taken = take(*arguments)
        held.wait(LIMIT_S)
        return taken

    monkeypatch.setattr(session.bus, "bulk_write", hold)
    session.session.start()
    session.found()
    for _ in range(5):
        assert session.session.send(b"forward " * 10 + b"#", 1)
    session.until(lambda: bool(session.bus.written), "it is written")
    assert session.session.stop(b"stop#")
    held.set()
    session.until(lambda: b"".join(session.bus.written).endswith(b"stop#"), "the stop")
    assert session.bus.written == [b"forward " * 8, b"#stop#"]


def test_a_session_feeds_the_watchdog_only_while_its_owner_runs() -> None:
    bench = SessionBench()
    bench.session = BrickSession(lambda: Brick(ADDRESS, bench.bus), lambda: None, b"alive#")
    bench.session.start()
    bench.until(lambda: len(bench.bus.written) > 2, "it is kept alive")
    bench.session.close()
    assert set(bench.bus.written) == {b"alive#"}


def keep_alive(silent_s: str) -> bytes:
    entry = DICTIONARY.spelling.keep_alive
    return encode(Message(entry.code, SOURCE, "MOCUP", entry.command, tuple(silent_s.split(","))))


def stages(rig: Rig, requested: Message) -> list[str]:
    return [message.message.outputs[0] for message in rig.answers(requested)]


def test_a_brick_that_does_not_stop_by_itself_is_reported_in_the_log_only(
    bench: Bench,
) -> None:
    requested = decode(keep_alive("0.5"))
    bench.sends(replace(requested, source="MOCUP", dest=SOURCE, outputs=("REJECTED", "", "")))
    assert bench.ports.notified == []
    assert bench.reported == ["the brick refuses KEEP_ALIVE: it does not stop by itself"]


def test_a_brick_with_a_silent_host_halts_and_gives_the_reason() -> None:
    rig = Rig()
    requested = rig.send("moveForward", "5.0")
    for _ in range(10):
        rig.receive(keep_alive(f"{HEARTBEAT_TIMEOUT_S:g}"))
        rig.run(0.3)
    assert stages(rig, requested) == ["STARTED"]
    rig.run(0.3)
    assert not rig.turning
    reported = rig.answers(requested)[-1].message
    assert reported.outputs == ("CANCELLED", "INTERRUPTED", "no message of the host for 0.5 s")


@pytest.mark.parametrize("bound", ["0.5,0.5", "soon", "0", "-1", "nan", "inf"])
def test_a_brick_obeys_no_bound_that_is_none(bound: str) -> None:
    rig = Rig()
    rig.receive(keep_alive("0.5"))
    rig.receive(keep_alive(bound))
    requested = rig.send("moveForward", "5.0")
    rig.run(0.4)
    assert stages(rig, requested) == ["STARTED"]
    rig.run(0.3)
    assert stages(rig, requested) == ["STARTED", "CANCELLED"]


def test_a_brick_stops_for_any_content_of_a_stop() -> None:
    rig = Rig()
    rig.send("moveForward", "5.0")
    rig.run(0.4)
    rig.receive(encode(replace(command("stop", 1, "1.0", "x"), command="HALT")))
    rig.step()
    assert not rig.turning


class Silences:
    """A monitor, and how often it found its commander silent."""

    def __init__(self) -> None:
        self.count = 0
        self.monitor = HeartbeatMonitor(HEARTBEAT_TIMEOUT_S, self.silent)

    def silent(self) -> None:
        self.count += 1

    def poll(self, times: int) -> None:
        for _ in range(times):
            self.monitor.update()


def test_a_commander_times_out_after_five_polls_and_is_reported_once() -> None:
    silences = Silences()
    silences.poll(20)
    assert silences.count == 0, "who was never there cannot be gone"
    silences.monitor.heartbeat(1)
    silences.poll(4)
    assert (silences.count, silences.monitor.alive) == (0, True)
    silences.poll(20)
    assert (silences.count, silences.monitor.alive) == (1, False)
    silences.monitor.heartbeat(1)
    silences.poll(5)
    assert silences.count == 2


def test_a_commander_without_a_heartbeat_times_out_as_soon() -> None:
    silences = Silences()
    silences.monitor.command()
    silences.poll(5)
    assert silences.count == 1


def test_another_process_instead_of_the_commander_means_that_it_has_ended() -> None:
    silences = Silences()
    for sender in (1, 1, 2, 2):
        silences.monitor.heartbeat(sender)
    assert silences.count == 1


@pytest.mark.ros
@pytest.mark.slow
@pytest.mark.usefixtures("ros_domain", "warm_children")
@pytest.mark.parametrize(
    ("asset", "targets"), [("mocup", tuple(Target)), ("jackal", (Target.EXECUTIVE,))]
)
def test_a_rover_halts_when_its_commander_is_killed_in_mid_motion(
    asset: str, targets: tuple[Target, ...]
) -> None:
    standstill_s = kill_in_motion(asset, targets, 1, 3, print)
    for target, (after_s,) in standstill_s.items():
        assert after_s < WATCHED_S - 0.5, f"{target}: `rover bench dead-men` measures"
