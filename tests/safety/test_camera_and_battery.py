from math import nan

import pytest

from executive.commands import TakePicture
from executive.values.facts import Frame
from executive.values.parameters import Parameter
from executive.values.reasons import Reason, UnknownReason
from executive.values.reports import ReportKind, Severity, Stage
from tests.support.kinematic import Bench

WHOLE = b"\xff\xd8picture\xff\xd9"


def picture(bench: Bench, *stamps_s: float, data: bytes = WHOLE, number: int = 1) -> Stage:
    """Ask for a picture, let frames with these stamps come, and return how it ends."""
    bench.rover.camera_works = False
    bench.submit(TakePicture(), number)
    for stamp_s in stamps_s:
        bench.run(0.2)
        bench.rover.facts.append(Frame(stamp_s, "JPG", data))
    return bench.finish(number, 10.0)


@pytest.mark.at_length
def test_a_frame_from_before_the_request_is_no_picture(bench: Bench) -> None:
    bench.run(20.0)
    assert picture(bench, 2.0, 2.0) is Stage.FAILED
    assert bench.last(1).reason is Reason.CAPTURE_STALE
    assert bench.last(1).figures[0].value == pytest.approx(18.05, abs=0.1)
    assert not list(bench.folder.glob("files/pictures/*"))


def test_a_frame_of_now_is_waited_for(bench: Bench) -> None:
    bench.run(20.0)
    assert picture(bench, 2.0, 20.4) is Stage.EXECUTED


def test_a_cut_frame_is_no_picture(bench: Bench) -> None:
    assert picture(bench, 0.2, data=WHOLE[:-2]) is Stage.FAILED
    assert bench.last(1).reason is Reason.CAPTURE_TRUNCATED


def test_a_camera_with_a_clock_of_its_own_is_believed_until_it_repeats_itself(bench: Bench) -> None:
    bench.run(20.0)
    assert picture(bench, 5e8) is Stage.EXECUTED
    assert picture(bench, 5e8, number=2) is Stage.FAILED
    assert bench.last(2).reason is Reason.CAPTURE_STALE


def voltage(bench: Bench) -> float | None:
    """Return the voltage that is told."""
    return next(
        value.value
        for value in bench.executive.parameters()
        if value.parameter is Parameter.BATERY_VOLTAGE
    )


def warnings(bench: Bench) -> list[Reason | UnknownReason | None]:
    """Return the reasons of the warnings so far."""
    events = [report for report in bench.received.reports if report.kind is ReportKind.EVENT]
    return [event.reason for event in events if event.severity is Severity.WARNING]


def test_a_voltage_that_is_no_number_is_not_known_and_told(bench: Bench) -> None:
    assert voltage(bench) == 26.0
    bench.voltage_v = nan
    bench.run(1.0)
    assert voltage(bench) is None
    assert warnings(bench) == [Reason.BATTERY_NOT_FINITE]
    bench.voltage_v = 25.0
    bench.run(1.0)
    assert voltage(bench) == 25.0
    assert bench.received.reports[-1].reason is Reason.FAULT_CLEARED


def test_an_old_voltage_is_not_told_as_a_new_one(bench: Bench) -> None:
    bench.voltage_v = None
    bench.run(4.0)
    assert voltage(bench) == 26.0
    bench.run(2.0)
    assert voltage(bench) is None
    assert warnings(bench) == [Reason.BATTERY_SILENT]


def test_odometry_that_is_lost_while_nothing_moves_is_told(bench: Bench) -> None:
    bench.run(1.0)
    bench.odometry = False
    bench.run(1.2)
    assert warnings(bench) == [Reason.ODOMETRY_SILENT]
    bench.odometry = True
    bench.run(1.0)
    assert bench.received.reports[-1].reason is Reason.FAULT_CLEARED
