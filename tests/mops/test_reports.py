"""tests.mops.test_reports"""

from dataclasses import replace
from math import isnan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adapters.mops import (
    MAX_SEQUENCE,
    UNNUMBERED,
    LinkHealth,
    Message,
    MopsError,
    decode,
    encode,
    event_of,
    facts_of,
    health_message,
    health_of,
    ledger_of,
    load_dictionary,
    mode_of,
    parameters_of,
    refusal_of,
    reply_of,
    report_of,
    telemetry_of,
)
from adapters.mops.codec import MAX_ID, MAX_UTC_S
from adapters.mops.reports import MAX_TEXT_LENGTH
from executive.commands import Mode
from executive.commands.catalogue import MoveForward
from executive.values.facts import Battery, CameraAngles, Odometry
from executive.values.geometry import Pose, Velocity
from executive.values.parameters import Parameter, ParameterValue
from executive.values.reasons import Reason
from executive.values.reports import Identity, Report, ReportKind, Severity, Stage
from tests.mops.test_codec import NAMES

SPELLING = load_dictionary().spelling.telemetry
VALUES = ("1.0", "2.0", "0.5", "-1.5", "0.2", "1.0", "0.1", "-0.2", "8.1", "0.3", "-0.4", "1.0")


def telemetry(*values: str) -> Message:
    return Message(SPELLING.code, "MOCUP", "MOE", SPELLING.command, (), values, True)


def test_telemetry_becomes_facts() -> None:
    assert list(facts_of(telemetry(*VALUES), SPELLING, 7.0)) == [
        Odometry(7.0, Pose(1.0, 2.0, 0.5, -1.5), Velocity(0.1, -0.2)),
        Battery(8.1),
        CameraAngles(0.3, -0.4),
    ]


def test_an_unknown_value_is_no_fact() -> None:
    assert list(facts_of(telemetry(*[""] * len(VALUES)), SPELLING, 7.0)) == []
    no_heading = (*VALUES[:3], "", *VALUES[4:])
    assert Odometry not in map(type, facts_of(telemetry(*no_heading), SPELLING, 7.0))


def test_a_non_finite_value_is_reported_beside_the_rest() -> None:
    at = SPELLING.outputs.index(Parameter.BATERY_VOLTAGE)
    message = telemetry(*VALUES[:at], "nan", *VALUES[at + 1 :])
    odometry, battery, *_ = facts_of(message, SPELLING, 7.0)
    assert isinstance(odometry, Odometry)
    assert isinstance(battery, Battery)
    assert isnan(battery.voltage_v)
    with pytest.raises(MopsError, match="BATERY_VOLTAGE"):
        parameters_of(message, SPELLING, 7.0)


@pytest.mark.parametrize("value", ["one", "1.0.0"])
def test_an_invalid_number_is_refused(value: str) -> None:
    with pytest.raises(MopsError, match="POS_X"):
        list(facts_of(telemetry(value, *VALUES[1:]), SPELLING, 7.0))


def test_invalid_telemetry_is_refused() -> None:
    for message in (telemetry(*VALUES[1:]), Message(0x301, "a", "b", "EVENT", (), VALUES)):
        with pytest.raises(MopsError):
            list(facts_of(message, SPELLING, 7.0))


@given(st.lists(st.text(max_size=5), min_size=len(VALUES), max_size=len(VALUES)))
def test_no_telemetry_upsets_it(values: list[str]) -> None:
    try:
        list(facts_of(telemetry(*values), SPELLING, 7.0))
    except MopsError:
        return


DICTIONARY = load_dictionary()
MOVE = DICTIONARY.commands["moveForward"]
EVENT, LINK = DICTIONARY.spelling.event, DICTIONARY.spelling.link
TELEMETRY = DICTIONARY.spelling.telemetry
FINITE = st.floats(allow_nan=False, allow_infinity=False)
TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=MAX_TEXT_LENGTH)
NUMBERS = st.integers(1, MAX_SEQUENCE)
TIMES = st.floats(0.0, MAX_UTC_S)
RECEIVED_S = 99.0
REQUESTED = DICTIONARY.command(MoveForward(1.0), Identity("MOE", 7), "JACKAL")
EXECUTED = Report(
    sequence=12,
    utc_s=1.5,
    kind=ReportKind.COMMAND,
    severity=Severity.INFORMATIONAL,
    text="MoveForward",
    identity=Identity("MOE", 7),
    stage=Stage.EXECUTED,
    link="relay",
)
REPLIES = st.builds(
    Report,
    sequence=NUMBERS,
    utc_s=TIMES,
    kind=st.just(ReportKind.COMMAND),
    severity=st.sampled_from(Severity),
    text=TEXTS,
    identity=st.builds(Identity, NAMES, st.integers(0, MAX_ID)),
    stage=st.sampled_from(Stage),
    link=st.just("relay"),
    step=st.none() | st.integers(0, 1000),
    step_count=st.none() | st.integers(0, 1000),
    reason=st.none() | st.sampled_from(Reason),
)
EVENTS = st.builds(
    Report,
    sequence=NUMBERS,
    utc_s=TIMES,
    kind=st.just(ReportKind.EVENT),
    severity=st.sampled_from(Severity),
    text=TEXTS,
    reason=st.none() | st.sampled_from(Reason),
)


def decoded(message: Message) -> Report:
    return report_of(decode(encode(message)), DICTIONARY, RECEIVED_S)


@given(REPLIES)
def test_every_report_on_a_command_survives_the_round_trip(report: Report) -> None:
    reply = reply_of(report, MOVE, "JACKAL", 3)
    assert (reply.received, reply.executed) == (True, report.stage is Stage.EXECUTED)
    assert reply.moe_inputs_counter == 3
    assert decoded(reply) == report


@given(EVENTS)
def test_every_event_survives_the_round_trip(report: Report) -> None:
    assert decoded(event_of(report, EVENT, "JACKAL")) == report


def test_an_event_on_a_link_is_an_event() -> None:
    report = Report(1, 2.0, ReportKind.LINK, Severity.WARNING, "gone")
    assert decoded(event_of(report, EVENT, "JACKAL")) == replace(report, kind=ReportKind.EVENT)


def test_they_read_so() -> None:
    assert str(reply_of(EXECUTED, MOVE, "JACKAL")) == (
        "102|JACKAL|MOE|MOVE_FORWARD||EXECUTED,,MoveForward,12,1.5,INFORMATIONAL,,|True|True|7|#"
    )
    rejected = replace(
        EXECUTED,
        stage=Stage.REJECTED,
        reason=Reason.OUT_OF_RANGE,
        text="5 > 4, #1",
        severity=Severity.WARNING,
    )
    assert str(reply_of(rejected, MOVE, "JACKAL")) == (
        "102|JACKAL|MOE|MOVE_FORWARD||REJECTED,OUT_OF_RANGE,5 > 4%2C %231,12,1.5,WARNING,,"
        "|True|False|7|#"
    )
    refused = refusal_of(REQUESTED, "JACKAL", "another has it", Reason.DUPLICATE)
    assert str(refused) == (
        "102|JACKAL|MOE|MOVE_FORWARD||REJECTED,DUPLICATE,another has it|False|False|7|#"
    )


def test_a_refusal_before_reception_is_a_rejection_without_a_number() -> None:
    report = decoded(refusal_of(REQUESTED, "JACKAL", "another has it", Reason.DUPLICATE))
    assert (report.stage, report.reason) == (Stage.REJECTED, Reason.DUPLICATE)
    assert (report.sequence, report.utc_s) == (UNNUMBERED, RECEIVED_S)
    assert report.severity is Severity.WARNING


@pytest.mark.parametrize(
    ("outputs", "flags", "stage"),
    [
        (("EXECUTED",), (True, True), Stage.EXECUTED),
        (("STARTED", "", ""), (True, False), Stage.STARTED),
        (("REJECTED", "QUEUE_FULL", "BUSY: MOVE is under way"), (False, False), Stage.REJECTED),
        (("FAILED", "", "the brick is gone"), (False, False), Stage.FAILED),
        ((), (True, True), Stage.EXECUTED),
        ((), (True, False), Stage.RECEIVED),
        ((), (False, False), Stage.REJECTED),
    ],
)
def test_replies_of_a_brick_are_understood(
    outputs: tuple[str, ...], flags: tuple[bool, bool], stage: Stage
) -> None:
    received, executed = flags
    reply = Message(
        MOVE.code,
        "MOCUP",
        "MOE",
        MOVE.command,
        outputs=outputs,
        received=received,
        executed=executed,
        moe_inputs_id=7,
    )
    report = decoded(reply)
    assert (report.stage, report.identity) == (stage, Identity("MOE", 7))
    assert (report.sequence, report.utc_s) == (UNNUMBERED, RECEIVED_S)


REPLY = reply_of(EXECUTED, MOVE, "JACKAL")
REPORT = event_of(Report(5, 2.0, ReportKind.EVENT, Severity.ALARM, "hot"), EVENT, "JACKAL")


@pytest.mark.parametrize("ledger", ["", "9f3a01c4"])
def test_an_event_names_its_fault(ledger: str) -> None:
    over = Report(
        5, 2.0, ReportKind.EVENT, Severity.INFORMATIONAL, "x", reason=Reason.FAULT_CLEARED,
        fault="tilted",
    )  # fmt: skip
    message = event_of(over, EVENT, "JACKAL", ledger)
    assert decoded(message) == over
    assert ledger_of(message, DICTIONARY) == ledger


@pytest.mark.parametrize(
    ("message", "fault"),
    [
        (REQUESTED, "is no report"),
        (replace(REPLY, code=0x1FF), "1FF is no command"),
        (replace(REPLY, command="STOP"), "is MOVE_FORWARD, not STOP"),
        (replace(REPLY, moe_inputs_id=None), "replies to no command"),
        (replace(REPLY, outputs=(*REPLY.outputs, "1f", "")), "outputs: 10"),
        (replace(REPLY, outputs=("DONE", *REPLY.outputs[1:])), "'DONE' is no stage"),
        (replace(REPLY, outputs=("EXECUTED", "7")), "'7' is no reason"),
        (replace(REPLY, outputs=("EXECUTED", "", "", "0")), "sequence: 0 is not within 1 and"),
        (replace(REPLY, outputs=("EXECUTED", "", "", "9" * 19)), "sequence: 9999999999999999999"),
        (replace(REPLY, outputs=("EXECUTED", "", "", "1", "-1.0")), "utc_s: -1.0 is not within"),
        (replace(REPLY, outputs=("EXECUTED", "", "", "1", "1e19")), "utc_s: "),
        (replace(REPLY, outputs=("EXECUTED", "", "", "1", "", "", "-1")), "step: -1"),
        (
            replace(REPLY, outputs=("EXECUTED", "", "", "1", "", "", "1", "4294967296")),
            "step_count",
        ),
        (replace(REPLY, outputs=("EXECUTED", "", "", "1", "nan")), "utc_s"),
        (replace(REPLY, outputs=("EXECUTED", "", "", "1", "", "LOUD")), "'LOUD' is no severity"),
        (replace(REPLY, executed=False), "executed: False, and the stage is EXECUTED"),
        (replace(REPLY, received=False), "executed: True"),
        (replace(REPLY, outputs=("STARTED",)), "executed: True, and the stage is STARTED"),
        (
            replace(REPLY, outputs=("STARTED",), received=False, executed=False),
            "received: False, and the stage is STARTED",
        ),
        (replace(REPORT, outputs=REPORT.outputs[:3]), "outputs: 3, not 6 or 7"),
        (replace(REPORT, command="ALARM"), "is EVENT, not ALARM"),
        (replace(REPORT, outputs=("LOUD", *REPORT.outputs[1:])), "'LOUD' is no severity"),
        (replace(REPORT, outputs=(*REPORT.outputs[:3], "0", "1.0", "")), "sequence: 0"),
        (
            replace(REPORT, outputs=(*REPORT.outputs[:3], "9" * 10, "1.0", "")),
            "sequence: 9999999999",
        ),
        (replace(REPORT, outputs=(*REPORT.outputs[:4], "1e19", "")), "utc_s: "),
    ],
)
def test_an_unknown_message_is_named(message: Message, fault: str) -> None:
    with pytest.raises(MopsError, match=fault):
        report_of(message, DICTIONARY, RECEIVED_S)


def test_a_numbering_asset_names_its_ledger() -> None:
    event = Report(5, 2.0, ReportKind.EVENT, Severity.ALARM, "hot")
    for report, plain, named in (
        (EXECUTED, REPLY, reply_of(EXECUTED, MOVE, "JACKAL", ledger="9f3a")),
        (event, REPORT, event_of(event, EVENT, "JACKAL", "9f3a")),
    ):
        assert named.outputs == (*plain.outputs, "9f3a")
        assert (decoded(named), ledger_of(named, DICTIONARY)) == (report, "9f3a")
        assert (decoded(plain), ledger_of(plain, DICTIONARY)) == (report, "")
        for wrong in ("", "x" * 33, "a%20b", "a\u0661"):
            with pytest.raises(MopsError, match="ledger: "):
                ledger_of(replace(plain, outputs=(*plain.outputs, wrong)), DICTIONARY)


def test_a_report_on_a_command_is_no_event_and_vice_versa() -> None:
    with pytest.raises(MopsError):
        event_of(EXECUTED, EVENT, "JACKAL")
    with pytest.raises(MopsError):
        reply_of(Report(1, 2.0, ReportKind.EVENT, Severity.ALARM, "hot"), MOVE, "JACKAL")


def test_a_text_that_is_too_long_is_cut_and_still_fits() -> None:
    reply = reply_of(replace(EXECUTED, text="\U0001f916" * 5000), MOVE, "JACKAL")
    text = decoded(reply).text
    assert len(text) == MAX_TEXT_LENGTH
    assert text.endswith("…")


@given(st.lists(st.text(max_size=9), max_size=9), st.booleans(), st.booleans())
def test_no_message_upsets_it(outputs: list[str], received: bool, executed: bool) -> None:
    for message in (REPLY, REPORT):
        tried = replace(message, outputs=tuple(outputs), received=received, executed=executed)
        try:
            report_of(tried, DICTIONARY, RECEIVED_S)
        except MopsError:
            continue


@given(st.dictionaries(st.sampled_from(Parameter), st.none() | FINITE), st.sampled_from(Mode))
def test_parameters_and_mode_survive_the_round_trip(
    known: dict[Parameter, float | None], mode: Mode
) -> None:
    bare = telemetry_of(known, TELEMETRY, "JACKAL", "ALL")
    assert mode_of(bare, TELEMETRY) is None
    message = telemetry_of(known, TELEMETRY, "JACKAL", "ALL", mode)
    assert mode_of(decode(encode(message)), TELEMETRY) is mode
    with pytest.raises(MopsError, match="'FLYING' is no mode"):
        mode_of(replace(message, outputs=(*bare.outputs, "FLYING")), TELEMETRY)
    assert parameters_of(decode(encode(message)), TELEMETRY, 7.0) == tuple(
        ParameterValue(parameter, 7.0, known.get(parameter)) for parameter in TELEMETRY.outputs
    )


COUNTS = st.integers(0, 1 << 40)


@given(
    st.builds(
        LinkHealth,
        *(TIMES, COUNTS, FINITE, st.none() | FINITE, st.none() | FINITE, COUNTS, COUNTS),
        *(st.none() | st.booleans(), *[st.none() | COUNTS] * 6, st.none() | FINITE),
    )
)
def test_the_health_of_a_link_survives_the_round_trip(health: LinkHealth) -> None:
    assert health_of(decode(encode(health_message(health, LINK, "JACKAL"))), LINK) == health


def test_an_end_without_counters_reports_its_link_too() -> None:
    health = LinkHealth(1.0, 2, 0.5, None, None, 0, 0)
    message = health_message(health, LINK, "JACKAL")
    assert health_of(replace(message, outputs=message.outputs[:7]), LINK) == health
    with pytest.raises(MopsError, match="outputs: 8"):
        health_of(replace(message, outputs=message.outputs[:8]), LINK)


def test_a_message_without_link_state_is_refused() -> None:
    health = health_message(LinkHealth(1.0, 0, 0.0, None, None, 0, 0), LINK, "JACKAL")
    late = replace(health, outputs=("1e19", *health.outputs[1:]))
    for message in (REPORT, replace(REPORT, code=LINK.code, command=LINK.command), late):
        with pytest.raises(MopsError):
            health_of(message, LINK)
