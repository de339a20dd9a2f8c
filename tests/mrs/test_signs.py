"""What the rover takes for a sign of the ground on its direct link, and what not."""

import asyncio
import time
from collections.abc import Iterator
from dataclasses import replace

import pytest

from adapters.mal import InteractionStage, Subscription, encode_message
from adapters.mal.codec import decode_message
from adapters.mrs.aboard.served_operations import HeldMessages
from adapters.mrs.ground import MrsClient
from executive.commands import SetTravelSpeed, Stop
from tests.benchmarks.octets import Octets
from tests.mrs.aboard import Aboard
from tests.mrs.fleet import Fleet, eventually

SIGN_S = "adapters.mrs.ground.client.HEARTBEAT_S"


def silent_s(rover: Aboard, for_s: float = 0.05) -> float:
    """Let simulated time pass; return for how long nothing has been heard of the ground."""
    rover.run(for_s)
    return rover.do(lambda bench: bench.executive.ground.silent_s)


@pytest.fixture
def octets(aboard: Aboard) -> Iterator[Octets]:
    """Give a connection that says nothing by itself, after five seconds of silence."""
    with Octets(aboard.port) as octets:
        assert silent_s(aboard, 5.0) > 5.0
        yield octets


def test_an_open_connection_that_is_silent_is_silence(aboard: Aboard, octets: Octets) -> None:
    octets.send(octets.message("Status", "getStatus", InteractionStage.REQUEST))
    assert octets.reply()
    assert silent_s(aboard) < 0.1
    assert silent_s(aboard, 5.0) > 5.0
    octets.send(octets.message("Status", "getStatus", InteractionStage.REQUEST)[:-1])
    assert silent_s(aboard) > 5.0


@pytest.mark.parametrize(
    "operation", [("Authority", "getAuthority"), ("FileTransfer", "listFiles")]
)
def test_a_question_is_a_sign(aboard: Aboard, octets: Octets, operation: tuple[str, str]) -> None:
    values = (None,) * (operation[0] == "FileTransfer")
    octets.send(octets.message(*operation, InteractionStage.REQUEST, *values))
    assert octets.reply()
    assert silent_s(aboard) < 0.1


@pytest.mark.parametrize("request_", [SetTravelSpeed(0.5), SetTravelSpeed(99.0), Stop()])
def test_a_command_is_a_sign_also_if_it_is_refused(
    aboard: Aboard, octets: Octets, request_: SetTravelSpeed | Stop
) -> None:
    octets.request(request_)
    assert silent_s(aboard) < 0.1


def test_a_message_that_the_link_held_is_none(aboard: Aboard, octets: Octets) -> None:
    now_ns = time.time_ns()
    for age_s, expected in ((0, True), (100, False), (3, False), (1, True)):
        message = octets.message("Status", "getStatus", InteractionStage.REQUEST)
        header, body = decode_message(message)
        stamped = replace(header, timestamp_ns=now_ns - age_s * 1_000_000_000)
        octets.send(encode_message(stamped, body))
        assert octets.reply()
        assert (silent_s(aboard) < 0.1) is expected
        silent_s(aboard, 5.0)


def test_a_sender_without_a_clock_is_in_contact(aboard: Aboard, octets: Octets) -> None:
    for _ in range(3):
        header, body = decode_message(
            octets.message("Status", "getStatus", InteractionStage.REQUEST)
        )
        octets.send(encode_message(replace(header, timestamp_ns=0), body))
        assert octets.reply()
        assert silent_s(aboard) < 0.1
        silent_s(aboard, 5.0)


def test_delays_of_messages_are_compared_not_clocks() -> None:
    held = HeldMessages()
    outage = [held.is_held(sent_s, sent_s + 5.0) for sent_s in (0.0, 1.0, 2.0)]
    outage += [held.is_held(sent_s, 300.0 + sent_s / 1e3) for sent_s in (3.0, 4.0, 200.0, 294.0)]
    assert outage == [False, False, False, True, True, True, False]
    clock_set_back = [held.is_held(sent_s - 3600.0, sent_s + 5.0) for sent_s in (301.0, 302.0)]
    assert clock_set_back == [True, False]
    assert not held.is_held(-3290.0, 315.0)


def test_requests_between_rovers_and_a_subscription_are_none(
    aboard: Aboard, octets: Octets
) -> None:
    for operation in ("getServices", "getAsset"):
        octets.send(octets.message("ServiceLayer", operation, InteractionStage.REQUEST))
        assert octets.reply()
    subscription = Subscription(subscriptionId="all")
    octets.send(
        octets.message("Monitoring", "monitorValue", InteractionStage.REGISTER, subscription)
    )
    assert octets.reply()
    assert silent_s(aboard) > 5.0


def test_rovers_that_read_one_another_do_not_take_each_other_for_the_ground(
    fleet: Fleet, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(SIGN_S, 3600.0)
    jackal = fleet.launch("jackal")
    scout = fleet.launch("scout", above=jackal)

    def joined() -> bool:
        reports = scout.do(lambda bench: bench.received.reports)
        return any("registered as" in report.text for report in reports)

    eventually(joined)
    assert [silent_s(each, 1.0) > 1.0 for each in (jackal, scout)] == [True, True]


def test_a_client_that_only_listens_shows_that_it_is_there(
    aboard: Aboard, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(SIGN_S, 0.01)
    assert silent_s(aboard, 5.0) > 5.0

    async def listen(client: MrsClient) -> None:
        await client.telemetry()
        await asyncio.to_thread(eventually, lambda: silent_s(aboard) < 0.1)

    aboard.ground(listen)
