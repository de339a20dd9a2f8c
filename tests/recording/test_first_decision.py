"""The first different decision of two entries: the one closest to the cause, with figures."""

from dataclasses import replace

import pytest

from adapters.recording.first_decision import NOTHING, differing
from adapters.recording.messages import encode, topic_of
from adapters.recording.run_file import RecordedMessage
from executive.commands import Mode
from executive.core.recording import Decision, ModeChanged, ReportSent, VelocityCommanded
from executive.values.geometry import STANDING, Velocity
from executive.values.reasons import Reason
from executive.values.reports import Identity, Report, ReportKind, Severity, Stage

GO = Identity("MOE", 1)
DRIVE = VelocityCommanded(Velocity(1.0, 0.0))
ENDED = Report(
    sequence=3,
    utc_s=1_800_000_000.0,
    kind=ReportKind.COMMAND,
    severity=Severity.WARNING,
    text="0.31 m off",
    identity=GO,
    stage=Stage.FAILED,
    reason=Reason.OFF_TARGET,
    link="direct",
)


def messages(*items: Decision) -> list[RecordedMessage]:
    return [RecordedMessage(topic_of(each), encode(each)) for each in items]


def test_the_end_of_a_command_precedes_the_velocity_zero_after_it() -> None:
    ended = ModeChanged(Mode.IDLE, None, ""), ReportSent(ENDED), VelocityCommanded(STANDING)
    found = differing(messages(DRIVE), messages(*ended))
    assert found is not None
    assert (found.topic, found.identity) == ("/out/report_sent", GO)
    assert (found.recorded, found.replayed) == (NOTHING, "MOE:1 FAILED OFF_TARGET: 0.31 m off")
    assert found.group == ("FAILED OFF_TARGET", NOTHING)


@pytest.mark.parametrize(
    ("travel_mps", "recorded", "replayed"),
    [
        (0.9, "velocity 1.00 m/s, 0.00 rad/s", "velocity 0.90 m/s, 0.00 rad/s"),
        (0.9999, "velocity 1.0000 m/s, 0.0000 rad/s", "velocity 0.9999 m/s, 0.0000 rad/s"),
    ],
)
def test_velocities_are_shown_with_the_digits_that_differ(
    travel_mps: float, recorded: str, replayed: str
) -> None:
    found = differing(messages(DRIVE), messages(VelocityCommanded(Velocity(travel_mps, 0.0))))
    assert found is not None
    assert (found.recorded, found.replayed) == (recorded, replayed)
    assert found.group == ("velocity: travel slower", "")
    assert found.change == pytest.approx(travel_mps - 1.0)


def test_last_digits_texts_and_figures_are_no_decisions() -> None:
    before = messages(DRIVE, ReportSent(ENDED), ModeChanged(Mode.MOVING, GO, "2.42 m left"))
    after = messages(
        VelocityCommanded(Velocity(1.0 - 1e-9, -1e-9)),
        ReportSent(replace(ENDED, text="0.32 m off", sequence=4)),
        ModeChanged(Mode.MOVING, GO, "2.41 m left"),
    )
    assert before != after
    assert differing(before, after) is None
