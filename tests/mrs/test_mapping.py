"""Core types to MRS values and back, without a socket."""

from contextlib import suppress
from dataclasses import replace
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adapters.explanation import entry_line
from adapters.mal import (
    AttributeType,
    MalError,
    NamedValue,
    SpecificationError,
    StandardError,
    TypedAttribute,
    TypedList,
)
from adapters.mrs.cli.sending import report_line
from adapters.mrs.cli.terminal import echo_json
from adapters.mrs.ground.client import EPOCH_MS, CommandIdGenerator
from adapters.mrs.spec import (
    REQUESTS,
    NotificationKind,
    Stage,
    command_of,
    describe_error,
    forwarded_command,
    frame_supplements,
    framed,
    header_of,
    invocation,
    lost_command,
    notification_keys,
    notification_of,
    refusal_error,
    report_of,
    supplements_of,
    with_text,
)
from adapters.mrs.spec.mapping import carrier_of
from adapters.mrs.spec.types import Severity
from executive.commands import (
    Command,
    MoveForward,
    MoveTo,
    PreemptionPolicy,
    Request,
    Stop,
    Waypoint,
    declaration_of,
)
from executive.values import reports
from executive.values.reasons import Figure, Reason, Refusal
from executive.values.reports import Identity
from tests.support.preconditions import PRECONDITIONS
from tests.support.timed_system import TimedSystem

requests = st.one_of(*(st.from_type(kind) for kind in get_args(Request)))
commands_of_any_kind = st.builds(
    Command,
    identity=st.builds(Identity, st.text(min_size=1), st.integers(1, (1 << 63) - 1)),
    request=requests,
    link=st.just("direct"),
    created_utc_s=st.none() | st.integers(0, 4_000_000).map(lambda ms: ms / 1000),
    lifetime_s=st.none() | st.floats(0, 1000),
    counter=st.none() | st.integers(0, 1000),
    report_started=st.booleans(),
    report_progress=st.booleans(),
    preemption=st.sampled_from(PreemptionPolicy),
    authority=st.none() | st.integers(1, (1 << 63) - 1),
    precondition=PRECONDITIONS.map(lambda only: only or None),
)


@given(requests)
def test_a_request_is_decoded_from_its_operation(request: Request) -> None:
    call = invocation(request)
    made = REQUESTS[call.service, call.operation](*call.parts)
    back = framed(made, frame_supplements(request))
    assert repr(back) == repr(request)  # NaN equals nothing


def test_a_declaration_that_is_not_the_operation_is_refused() -> None:
    declared = declaration_of(MoveForward)
    (distance,) = declared.arguments
    with pytest.raises(KeyError, match="moveBackward"):
        carrier_of(replace(declared, operation="moveBackward"))
    for change in ({"name": "way"}, {"kind": int}, {"optional": True}, {"repeated": True}):
        wrong = replace(declared, arguments=(replace(distance, **change),))
        with pytest.raises(SpecificationError, match=r"MotionControl\.moveForward"):
            carrier_of(wrong)
    with pytest.raises(SpecificationError, match="its only part must be settings"):
        carrier_of(replace(declared, part="settings"))


@given(commands_of_any_kind)
def test_a_command_is_decoded_from_its_header(command: Command) -> None:
    header, supplements = header_of(command), supplements_of(command)
    if isinstance(command.request, Stop):  # to which neither says anything
        command = replace(
            command, preemption=PreemptionPolicy.APPEND, authority=None, precondition=None
        )
    assert command_of(header, supplements, command.request) == command


def supplement(kind: AttributeType, value: object) -> NamedValue:
    return NamedValue(name="preemption", value=TypedAttribute(kind, value))


HEADER = header_of(Command(Identity("MOE", 1), Stop(), "direct"))


def test_a_frame_that_is_none_is_invalid() -> None:
    value = TypedAttribute(AttributeType.IDENTIFIER, "utm")
    with pytest.raises(MalError) as raised:
        command_of(HEADER, (NamedValue(name="frame", value=value),), MoveTo(Waypoint(1.0, 0.0)))
    assert "supplement frame: one Identifier, map or odom" in describe_error(raised.value)


def test_supplements_of_others_do_not_set_preemption() -> None:
    other = NamedValue(name="trace", value=TypedAttribute(AttributeType.STRING, "replace"))
    assert command_of(HEADER, (other,), MoveForward(1.0)).preemption is PreemptionPolicy.APPEND


@pytest.mark.parametrize(
    "supplements",
    [
        (supplement(AttributeType.IDENTIFIER, "later"),),
        (supplement(AttributeType.STRING, "replace"),),
        (NamedValue(name="preemption"),),
        (supplement(AttributeType.IDENTIFIER, "append"),) * 2,
        (NamedValue(name="authority", value=TypedAttribute(AttributeType.STRING, "7")),),
        (NamedValue(name="authority"),),
        (NamedValue(name="authority", value=TypedAttribute(AttributeType.LONG, 7)),) * 2,
        (NamedValue(name="onlyAt", value=TypedAttribute(AttributeType.STRING, "1 2 0")),),
        (NamedValue(name="onlyAt", value=TypedAttribute(AttributeType.IDENTIFIER, "1 2 3")),),
        (NamedValue(name="onlyAt"),),
        (NamedValue(name="onlyAfter", value=TypedAttribute(AttributeType.LONG, 7)),) * 2,
        (NamedValue(name="onlyAfter", value=TypedAttribute(AttributeType.LONG, 0)),),
        (NamedValue(name="onlyMode", value=TypedAttribute(AttributeType.IDENTIFIER, "idle")),),
        (NamedValue(name="onlyMode", value=TypedAttribute(AttributeType.LONG, 1)),),
    ],
)
def test_an_ambiguous_supplement_is_invalid_but_does_not_prevent_a_stop(
    supplements: tuple[NamedValue, ...],
) -> None:
    with pytest.raises(MalError) as raised:
        command_of(HEADER, supplements, MoveForward(1.0))
    assert describe_error(raised.value).startswith(f"Invalid: supplement {supplements[0].name}: ")
    stop = command_of(HEADER, supplements, Stop())
    assert (stop.preemption, stop.precondition) == (PreemptionPolicy.APPEND, None)


@given(
    st.sampled_from(("onlyAt", "onlyAfter", "onlyMode")),
    st.builds(
        TypedAttribute,
        st.sampled_from((AttributeType.STRING, AttributeType.IDENTIFIER)),
        st.text(max_size=30) | st.sampled_from(("1 2 3", "1 -2.5 1e-3 4 1", "IDLE")),
    )
    | st.builds(
        TypedAttribute, st.just(AttributeType.LONG), st.integers(-(1 << 63), (1 << 63) - 1)
    ),
)
def test_no_precondition_is_passed_over(name: str, value: TypedAttribute) -> None:
    supplements = (NamedValue(name=name, value=value),)
    with suppress(MalError):
        found = command_of(HEADER, supplements, MoveForward(1.0))
        assert found.precondition
        (again,) = supplements_of(found)
        assert again.name == name


@pytest.mark.parametrize(
    ("reason", "number", "extra"),
    [
        (Reason.OUT_OF_RANGE, 1, TypedList(AttributeType.UINTEGER, (2,))),
        (Reason.WRONG_MODE, 2, TypedAttribute(AttributeType.STRING, "why")),
        (Reason.DUPLICATE, 3, TypedAttribute(AttributeType.LONG, 7)),
        (Reason.NOT_SUPPORTED, 4, TypedAttribute(AttributeType.STRING, "why")),
        (Reason.QUEUE_FULL, 6, TypedAttribute(AttributeType.STRING, "why")),
        (Reason.LEDGER_FAILED, 2, TypedAttribute(AttributeType.STRING, "why")),
    ],
)
def test_the_block_of_a_reason_decides_the_error(
    reason: Reason, number: int, extra: object
) -> None:
    error = refusal_error(Refusal(reason, "why", argument=2), Identity("MOE", 7))
    assert (error.number, error.extra) == (number, extra)


def test_a_refusal_that_blames_no_argument_names_none() -> None:
    error = refusal_error(Refusal(Reason.NOT_FINITE, "why"), Identity("MOE", 7))
    assert error.extra == TypedList(AttributeType.UINTEGER, ())


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (refusal_error(Refusal(Reason.NOT_FINITE, "", argument=2), Identity("A", 1)), "argument 2"),
        (refusal_error(Refusal(Reason.DUPLICATE, ""), Identity("A", 71)), "command id 71"),
        (
            refusal_error(Refusal(Reason.NOT_SUPPORTED, "no PNG"), Identity("A", 1)),
            "NotSupported: no PNG",
        ),
        (with_text(StandardError.INTERNAL, "asleep"), "INTERNAL: asleep"),
        (MalError(77), "77"),
        (MalError(StandardError.DESTINATION_LOST), "the connection was lost (DESTINATION_LOST)"),
    ],
)
def test_errors_read_as_text(error: MalError, text: str) -> None:
    assert text in describe_error(error)


def test_a_report_becomes_a_notification() -> None:
    report = reports.Report(
        sequence=12,
        utc_s=1_800_000_000.25,
        kind=reports.ReportKind.COMMAND,
        severity=reports.Severity.WARNING,
        text="distance is above its bound",
        identity=Identity("MOE", 9),
        stage=reports.Stage.REJECTED,
        reason=Reason.OUT_OF_RANGE,
        figures=(Figure("distance", 120.0, "m"), Figure("bound", 100, "m")),
    )
    found = notification_of(report)
    assert found.kind is NotificationKind.COMMAND
    assert found.severity is Severity.WARNING
    assert found.stage is Stage.REJECTED
    assert (found.sequence, found.timestamp) == (12, 1_800_000_000_250_000_000)
    assert (found.commandId, found.source, found.code) == (9, "MOE", 102)
    assert found.parameters == (
        NamedValue(name="distance", value=TypedAttribute(AttributeType.DOUBLE, 120.0)),
        NamedValue(name="bound", value=TypedAttribute(AttributeType.DOUBLE, 100.0)),
    )
    assert notification_keys("jackal", found) == ("jackal", 1, 2, 9, 3)


def test_a_reason_of_a_newer_rover_retains_its_number_and_text(
    capsys: pytest.CaptureFixture[str],
) -> None:
    known = reports.Report(
        12, 1.8e9, reports.ReportKind.COMMAND, reports.Severity.WARNING, "the mast is cold"
    )
    received = replace(notification_of(known), code=7999)
    report = report_of(received)
    assert report.reason is not None
    assert (report.reason.value, report.reason.name) == (7999, "unknown here")
    assert report.text == "the mast is cold"
    assert notification_of(report) == received
    assert "7999 unknown here: the mast is cold" in report_line(report)
    assert "unknown here 7999" in entry_line(report, str)
    echo_json(report)
    assert '"reason": 7999' in capsys.readouterr().out


def test_a_report_without_command_has_no_command_in_its_keys() -> None:
    event = reports.Report(1, 0.0, reports.ReportKind.EVENT, reports.Severity.ALARM, "tilted")
    assert notification_keys("jackal", notification_of(event)) == ("jackal", 2, 3, None, None)


def test_the_fields_of_a_report_are_decoded_from_its_notification() -> None:
    event = reports.Report(1, 0.0, reports.ReportKind.EVENT, reports.Severity.ALARM, "tilted")
    for names in (
        {"fault": "tilted"},
        {"cause": Identity("MOE", 9)},
        {"publishers": ("/joystick",)},
        {"publishers": ()},
    ):
        report = replace(event, **names)
        assert report_of(notification_of(report)) == report
    lost = replace(event, kind=reports.ReportKind.LINK, identity=Identity("MOE", 9))
    assert report_of(notification_of(lost)) == lost
    assert lost_command(lost) == lost.identity
    assert forwarded_command(lost) is None


def test_numbers_of_kin_are_equal() -> None:
    for ours, theirs in ((reports.Stage, Stage), (reports.Severity, Severity)):
        assert {m.name: m.value for m in ours} == {m.name: m.value for m in theirs}


def test_command_numbers_grow_within_and_across_clients() -> None:
    now_s = [(EPOCH_MS + 5) / 1000]
    system = TimedSystem(lambda: now_s[0])
    first = CommandIdGenerator(system)
    assert [first.next_id(), first.next_id(), first.next_id()] == [5, 6, 7]
    now_s[0] += 0.01
    assert [first.next_id(), CommandIdGenerator(system).next_id()] == [15, 15]
    assert CommandIdGenerator(TimedSystem(lambda: 0.0)).next_id() == 1
