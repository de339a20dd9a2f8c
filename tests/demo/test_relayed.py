"""Scenarios through an orbiter: real sockets and bundles, a rover that answers, a clock of ours."""

import asyncio
import re
from dataclasses import replace

import pytest
from rich.console import Console

from adapters.bundle.links.contact import Contact, ContactPlan
from executive.values.reasons import Reason
from executive.values.reports import Stage
from sim.demo.display import LineDisplay
from sim.demo.session import by_both, late_ticks, odometry_late
from sim.scenario.expect_commands import LifecycleExpectation
from sim.scenario.model import RunMode
from sim.scenario.pictures import passage_lane, queue_figures
from sim.scenario.record import Record, Scheduled, StageTime
from sim.scenario.sent import sent_commands
from tests.demo.playing import play
from tests.relay.orbiter.sky import Clock, Sky, landed, orbiting, until

TEXT = """
- {at: 0, command: {moveForward: {distance: 5}}, label: too-old, lifetime: 0.5}
- {at: 0, command: {setTravelSpeed: {speed: 0.5}}, label: waits}
- {after: waits ENDED, repeat: waits}"""


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> tuple[Record, str]:
    """Play the entries in an eclipse that lasts for an hour; give what was printed, too."""
    folder, console = tmp_path_factory.mktemp("relayed"), Console(width=110)

    async def run() -> Record:
        relay, clock = Sky(folder, "jackal"), Clock()
        dawn_s = clock.utc_s() + 3600.0
        plan = ContactPlan((Contact(dawn_s, dawn_s + 600.0, 1, 2, 100_000),))
        seen: list[Record] = []
        async with (
            orbiting(relay, clock, plan) as (_, (station,)),
            landed(relay, "jackal") as rover,
        ):
            with LineDisplay(console) as shown:
                view = shown.view(["relay"])

                def on_update(record: Record) -> None:
                    seen[:] = [record]
                    view.on_update(record)

                uris = {"relay": str(station.uri)}
                playing = asyncio.create_task(play(folder, RunMode.RELAY, uris, TEXT, on_update))
                await until(lambda: bool(seen) and len(seen[0].sendings) == 2)
                await until(lambda: seen[0].expiry("too-old") is not None)
                await until(lambda: seen[0].statuses[-1].values["DTN_QUEUED"] == 1)
                assert rover.commands == []
                clock.shift_s = 3601.0
                record = await playing
            assert [message.command for message in rover.commands] == ["SET_TRAVEL_SPEED"]
            return record

    with console.capture() as printed:
        record = asyncio.run(run())
    return record, printed.get()


def test_a_command_without_contact_is_stored_and_executed_after_it(
    played: tuple[Record, str],
) -> None:
    record, text = played
    expired, waiting, again = sent_commands(record)
    assert [each.ending for each in (expired, waiting, again)] == [
        "EXPIRED",
        "EXECUTED",
        "DUPLICATE",
    ]
    stages = [Stage.RECEIVED, Stage.ACCEPTED, Stage.STARTED, Stage.EXECUTED]
    assert [receipt.report.stage for receipt in waiting.receipts] == stages
    assert expired.stored
    assert expired.receipts == ()
    assert expired.text == "its lifetime ended at the orbiter"
    assert again.receipts == (), "it is known by the same link: the first one's report is no life"
    assert re.search(r"no contact, next in \d+ s +queue \d", text), text
    assert re.search(r"^ 2 setTravelSpeed.* relay +0\.\d\d .*EXECUTED", text, re.MULTILINE), text


def test_a_command_lost_by_the_orbiter_has_ended_for_waiters_and_expectations(
    played: tuple[Record, str],
) -> None:
    record, _ = played
    for stage, holds in ((Stage.EXPIRED, True), (Stage.EXECUTED, False)):
        assert LifecycleExpectation(command="too-old", ends=stage).judge(record).passed is holds
    for after in (StageTime("too-old", "ENDED"), StageTime("too-old", "EXPIRED")):
        assert record.resolve_time(Scheduled(after=after)) is not None
    assert record.resolve_time(Scheduled(after=StageTime("too-old", "EXECUTED"))) is None


def test_a_lane_shows_the_location_of_a_command(played: tuple[Record, str]) -> None:
    record, _ = played
    expired, waiting, again = (passage_lane(sent).passage for sent in sent_commands(record))
    assert expired is not None
    assert expired.stored_s is not None
    assert expired.lost_s is not None
    assert expired.sent_s < expired.stored_s < expired.lost_s
    assert expired.received is None
    assert waiting is not None
    assert waiting.ended is not None
    assert waiting.ended.ground_s >= waiting.ended.made_s > waiting.sent_s
    assert again is not None
    assert again.again
    (at_the_orbiter, commands), (aboard, _) = queue_figures(record)
    assert at_the_orbiter == "commands queued at the orbiter"
    assert aboard == "reports queued aboard"
    assert commands.startswith("2 of 2"), "the one that was given up there waited too"
    assert list(by_both(record)) == [], "it was sent again by the same link"


def test_late_odometry_is_known_later(played: tuple[Record, str]) -> None:
    record, _ = played
    assert not odometry_late(record)
    stationary = replace(record.reports[-1], reason=Reason.ODOMETRY_STALE)
    assert odometry_late(replace(record, reports=[*record.reports, stationary]))


def test_late_ticks_are_counted_from_the_first_status(played: tuple[Record, str]) -> None:
    record, _ = played
    first, *_, last = record.statuses
    counted = [
        replace(each, values={**each.values, "EXEC_OVERRUNS": count})
        for each, count in ((first, 7.0), (last, 47.0))
    ]
    assert late_ticks(replace(record, statuses=counted)) == 40
    assert late_ticks(replace(record, statuses=[])) == 0
