"""The relay link aboard, over real topics: what comes, what is told, and what is told again."""

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import pytest
from geometry_msgs.msg import Twist

from adapters.mops import UNNUMBERED, housekeeping_of, ledger_of, mode_of, parameters_of
from adapters.relay.rover.executive_link import PAGE
from executive.commands import Mode
from executive.commands.catalogue import ConfirmPose, MoveForward, Resume, SetTravelSpeed, Stop
from executive.commands.intake import SOURCE_PREFIX
from executive.values.parameters import Parameter
from executive.values.reasons import Reason
from executive.values.reports import Identity, ReportKind, Severity, Stage
from tests.relay.rover.aboard import DICTIONARY, STAGES, Aboard, Relay

pytestmark = pytest.mark.ros


@pytest.fixture
def aboard(ros_domain: int, tmp_path: Path) -> Iterator[Aboard]:
    assert ros_domain
    with ExitStack() as stack:
        aboard = Aboard(tmp_path, stack)
        stack.callback(aboard.end)
        yield aboard


def test_the_life_cycle_of_a_command_and_the_telemetry_are_published(aboard: Aboard) -> None:
    request_message = aboard.request(SetTravelSpeed(0.25), 7)
    aboard.reported(7, Stage.EXECUTED)
    assert aboard.relay.stages(7) == STAGES
    assert aboard.executive.status.travel_speed_mps == 0.25
    last = next(m for m in reversed(aboard.relay.messages) if m.moe_inputs_id == 7)
    assert (last.source, last.dest, last.code) == ("JACKAL", "MOE", request_message.code)
    assert (last.received, last.executed) == (True, True)

    def speed() -> list[float | None]:
        reported = [m for m in aboard.relay.messages if m.command == "TELEMETRY"]
        values = parameters_of(reported[-1], DICTIONARY.spelling.telemetry, 0.0) if reported else ()
        assert not reported or mode_of(reported[-1], DICTIONARY.spelling.telemetry) is aboard.mode()
        return [v.value for v in values if v.parameter is Parameter.TRAVEL_SPEED]

    aboard.until(lambda: speed() == [0.25], "telemetry")


def test_an_uncertain_pose_is_reported_before_the_next_housekeeping_is_due(aboard: Aboard) -> None:
    def reported() -> list[float | None]:
        entry = DICTIONARY.spelling.housekeeping
        found = [m for m in aboard.relay.messages if m.code == entry.code]
        return [housekeeping_of(m, entry).figures["EXEC_POSITION_UNCERTAINTY"] for m in found]

    aboard.send_housekeeping()
    aboard.until(lambda: reported() == [0.0], "the first housekeeping")
    aboard.send_housekeeping()
    aboard.request(ConfirmPose(0.5, 0.0), 7)
    aboard.reported(7, Stage.EXECUTED)
    aboard.until(lambda: "|EVENT||WARNING,POSE_UNCERTAIN," in "".join(aboard.relay.received), "it")
    aboard.send_housekeeping()
    aboard.until(lambda: reported()[1:] == [0.5], "the second housekeeping")


def test_a_stop_acts_during_any_activity_of_the_core(aboard: Aboard) -> None:
    stop = DICTIONARY.command(Stop(), Identity("MOE", 7), "JACKAL")
    aboard.relay.stop(str(stop))
    aboard.until_without_core(
        lambda: [each.twist for each in aboard.relay.velocities] == [Twist()], "it stands"
    )
    aboard.reported(7, Stage.STARTED)
    assert aboard.mode() is Mode.STOPPED


def test_a_stop_holds_and_what_moves_is_refused_with_a_reason(aboard: Aboard) -> None:
    aboard.request(Stop(), 1)
    aboard.reported(1, Stage.STARTED)
    assert aboard.mode() is Mode.STOPPED
    aboard.request(MoveForward(1.0), 2)
    aboard.reported(2, Stage.REJECTED)
    assert aboard.relay.stages(2) == [Stage.RECEIVED, Stage.REJECTED]
    (rejected,) = [r for r in aboard.relay.reports if r.stage is Stage.REJECTED]
    assert rejected.reason is Reason.WRONG_MODE
    aboard.request(Resume(), 3)
    aboard.reported(3, Stage.EXECUTED)
    assert aboard.mode() is not Mode.STOPPED


@pytest.mark.parametrize("first", ["direct", "relay"])
def test_a_duplicate_is_executed_once_and_its_end_reported(aboard: Aboard, first: str) -> None:
    if first == "direct":
        aboard.direct(SetTravelSpeed(0.25), 7)
    else:
        aboard.request(SetTravelSpeed(0.25), 7)
        aboard.reported(7, Stage.EXECUTED)
        aboard.relay.received.clear()
    aboard.executive.status.travel_speed_mps = 0.5
    aboard.request(SetTravelSpeed(0.25), 7)
    aboard.reported(7, Stage.EXECUTED)
    assert aboard.relay.stages(7) == [Stage.EXECUTED]
    assert aboard.executive.status.travel_speed_mps == 0.5


def test_a_command_by_the_direct_link_only_is_not_reported(aboard: Aboard) -> None:
    aboard.direct(SetTravelSpeed(0.25), 7)
    aboard.request(SetTravelSpeed(0.25), 8)
    aboard.reported(8, Stage.EXECUTED)
    assert aboard.relay.stages(7) == []


def test_a_number_of_another_command_is_refused_and_its_reports_stay_its_own(
    aboard: Aboard,
) -> None:
    aboard.direct(SetTravelSpeed(0.25), 7)
    aboard.request(SetTravelSpeed(0.3), 7)
    aboard.reported(7, Stage.REJECTED)
    (refused,) = [r for r in aboard.relay.reports if r.identity == Identity("MOE", 7)]
    assert (refused.reason, refused.sequence) == (Reason.DUPLICATE, UNNUMBERED)
    assert aboard.executive.status.travel_speed_mps == 0.25


def test_an_invalid_command_for_this_rover_moves_nothing(aboard: Aboard) -> None:
    good = DICTIONARY.command(SetTravelSpeed(0.25), Identity("MOE", 9), "JACKAL")
    plan = DICTIONARY.command(Stop(), Identity(f"{SOURCE_PREFIX}1", 1), "JACKAL")
    unnumbered = replace(good, moe_inputs_id=None)
    wrong = replace(good, inputs=("fast",), moe_inputs_id=1)
    unknown = replace(good, code=0xFFF, command="FLY", moe_inputs_id=2)
    others = replace(good, dest="MOCUP", moe_inputs_id=3)
    reply = replace(good, received=True, moe_inputs_id=4)
    aboard.relay.send("FLY#" + "".join(map(str, (unnumbered, wrong, unknown, others, reply, plan))))
    aboard.relay.send(f"{good}half")
    aboard.reported(9, Stage.EXECUTED)
    aboard.until(lambda: len(aboard.relay.refused) == 4, "refusals")
    refused = aboard.relay.refused
    assert [(m.dest, m.moe_inputs_id, m.received) for m in refused] == [
        ("MOE", None, False),
        ("MOE", 1, False),
        ("MOE", 2, False),
        (f"{SOURCE_PREFIX}1", 1, False),
    ]
    assert [m.outputs[2] for m in refused[:3]] == [
        "moeinputsid: a command needs a number",
        "speed_mps: 'fast' is no number",
        "code FFF is no command",
    ]
    assert aboard.relay.stages(3) == aboard.relay.stages(4) == []


def test_unacknowledged_reports_are_sent_to_the_next_relay(aboard: Aboard) -> None:
    aboard.request(SetTravelSpeed(0.2), 1)
    aboard.reported(1, Stage.EXECUTED)
    aboard.relay.stores = False
    aboard.request(SetTravelSpeed(0.25), 2)
    aboard.reported(2, Stage.EXECUTED)
    before = [r for r in aboard.relay.reports if r.identity == Identity("MOE", 2)]
    aboard.relay.store("another string")
    with ExitStack() as stack:
        aboard.relay = Relay(stack)
        aboard.reported(2, Stage.EXECUTED)
        assert [r for r in aboard.relay.reports if r.identity == Identity("MOE", 2)] == before
        assert aboard.relay.stages(1) == []


def test_an_acknowledged_report_does_not_acknowledge_those_before_it(
    aboard: Aboard, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("adapters.relay.rover.executive_link.RETRANSMIT_POLLS", 2)
    monkeypatch.setattr("adapters.relay.rover.executive_link.PAGE", 1)
    aboard.relay.stores = False
    aboard.request(SetTravelSpeed(0.25), 1)
    aboard.reported(1, Stage.EXECUTED)
    first, *others = aboard.relay.strings_of_reports
    assert others
    for text in others:
        aboard.relay.store(text)
    aboard.relay.received.clear()
    aboard.until(lambda: len(aboard.relay.stages(1)) > 2, "what is not kept is told again")
    aboard.relay.stores = True
    aboard.reported(1, Stage.RECEIVED)
    assert set(aboard.relay.strings_of_reports) == {first}
    aboard.request(SetTravelSpeed(0.25), 2)
    aboard.reported(2, Stage.EXECUTED)


def test_an_unreceived_life_cycle_is_reported_after_a_restart(aboard: Aboard) -> None:
    aboard.relay.stores = False
    aboard.request(SetTravelSpeed(0.25), 1)
    aboard.reported(1, Stage.EXECUTED)
    aboard.restart()
    aboard.relay.received.clear()
    aboard.relay.stores = True
    aboard.reported(1, Stage.EXECUTED)
    assert aboard.relay.stages(1) == STAGES


def test_events_are_reported(aboard: Aboard) -> None:
    aboard.executive.report_event(Severity.WARNING, "somebody is near")
    aboard.until(lambda: bool(aboard.relay.reports), "an event")
    (event,) = aboard.relay.reports
    assert (event.kind, event.text) == (ReportKind.EVENT, "somebody is near")


def test_reports_name_the_ledger_of_their_numbers(aboard: Aboard) -> None:
    names = []
    for number in (1, 2, 3):
        aboard.request(SetTravelSpeed(0.25), number)
        aboard.reported(number, Stage.EXECUTED)
        replies = [m for m in aboard.relay.messages if m.moe_inputs_id == number]
        names += [{ledger_of(reply, DICTIONARY) for reply in replies}]
        aboard.end()
        if number == 2:
            aboard.forget()
        aboard.restart()
        aboard.join()
    assert names[0] == names[1] != names[2]
    assert all(len(each) == 1 and "" not in each for each in names)


def test_a_long_life_cycle_is_reported_completely_and_in_order(aboard: Aboard) -> None:
    for number in range(1, 151):
        aboard.executive.report_event(Severity.INFORMATIONAL, f"event {number}")
    aboard.until(lambda: len(aboard.relay.reports) >= 150, "all events")
    sequences = [report.sequence for report in aboard.relay.reports]
    assert sequences == sorted(sequences)
    assert [r.text for r in aboard.relay.reports] == [f"event {n}" for n in range(1, 151)]
    assert len(set(aboard.relay.strings_of_reports)) == 150 / PAGE, "told together"
