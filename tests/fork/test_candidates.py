"""The changes that may save a run, and the minimal one of them."""

from collections.abc import Sequence
from dataclasses import dataclass

import pytest

from executive.commands import DriveFor, MoveForward, MoveTo, Request, Waypoint
from executive.settings import Controller, load_settings
from executive.values.reasons import Figure, Identity, Reason
from executive.values.reports import Report, ReportKind, Severity, Stage
from sim.fork.candidates import (
    arguments_of,
    candidate,
    controllers_for,
    limits_of,
    speeds_of,
)
from sim.fork.model import Change, Fidelity
from sim.fork.save import SaveAnswer, Saving, Search, Verdict

JACKAL = load_settings("jackal")
ID = Identity("MOE", 1)


def failed(reason: Reason, fault: str | None = None, *figures: Figure) -> Report:
    return Report(
        3,
        0.0,
        ReportKind.COMMAND,
        Severity.ALARM,
        "failed",
        ID,
        Stage.FAILED,
        reason=reason,
        fault=fault,
        figures=figures,
    )


def keys(report: Report) -> list[str]:
    return [each.key for each in limits_of(report, JACKAL)]


def test_limits_are_the_bounds_of_the_row_that_ended_the_command() -> None:
    assert keys(failed(Reason.OFF_COMMAND, "off_command")) == ["faults.off_command.above"]
    assert "faults.turn_off_command.above" in keys(failed(Reason.OFF_COMMAND))
    assert keys(failed(Reason.ODOMETRY_INCONSISTENT, "odometry_off_twist")) == [
        "faults.odometry_off_twist.quick.above",
        "faults.odometry_off_twist.slow.above",
    ]


def test_a_row_without_a_bound_has_the_duration_of_its_evidence() -> None:
    assert keys(failed(Reason.OTHER_PUBLISHER)) == ["faults.other_publisher.for"]


def test_a_setting_is_found_by_value_and_unit_of_the_bound_in_the_report() -> None:
    distance = Figure("distance", 120.0, "m"), Figure("bound", 100.0, "m")
    (limit,) = limits_of(failed(Reason.OUT_OF_RANGE, None, *distance), JACKAL)
    assert (limit.key, limit.by(1.25)) == ("drive.distance", 125.0)


def test_a_lower_bound_is_lowered_and_no_figure_leaves_its_bounds() -> None:
    (limit,) = limits_of(failed(Reason.NO_PROGRESS), JACKAL)
    assert limit.by(2.0) == JACKAL.faults.no_progress.bound / 2
    assert limit.by(1000.0) == limit.bound == 0.01
    (tilt,) = limits_of(failed(Reason.TILT_LIMIT, "tilt_limit"), JACKAL)
    assert tilt.by(1000.0) == tilt.bound == 1.5


def test_speeds_and_arguments_become_smaller() -> None:
    assert [each.key for each in speeds_of(JACKAL)] == ["drive.travel_speed", "drive.rotate_speed"]
    figures = [*arguments_of(ID, DriveFor(0.5, 0.0, -4.0))]
    assert [each.key for each in figures] == ["command.MOE:1.travel", "command.MOE:1.duration"]
    (replaced,) = candidate(figures[:1], 2.0).change.replaced
    assert replaced.request == DriveFor(0.25, 0.0, -4.0)


@pytest.mark.parametrize(
    ("request_", "found"),
    [
        (MoveTo(Waypoint(2.0, 1.0)), [Controller.MPC]),
        (MoveTo(Waypoint(2.0, 1.0), Controller.MPC), [Controller.TURN_DRIVE]),
        (MoveForward(1.0), []),
    ],
)
def test_other_controllers_are_tried_for_motions_to_targets(
    request_: Request, found: list[Controller]
) -> None:
    assert [each.change.controller for each in controllers_for(request_, JACKAL)] == found


def test_fewer_keys_precede_smaller_factors_and_arguments_last() -> None:
    speeds = [*speeds_of(JACKAL)]
    arguments = [*arguments_of(ID, MoveForward(3.0))]
    one, both = candidate(speeds[:1], 5.0), candidate(speeds, 1.1)
    shorter = candidate(arguments, 1.1)
    assert sorted([shorter, both, one], key=lambda each: each.order) == [one, both, shorter]


@dataclass(frozen=True)
class Monitors:
    """A run that ends by the first monitor with a bound below the needed one.

    Attributes:
        needed: least bound and report of each monitor, by its key, in their order.
        saving: texts of settings that make the run succeed at any bounds.
        unlucky: seeds that fail with any change.
        by_chance: whether it failed by chance: without a change it succeeds with each seed.
    """

    needed: dict[str, tuple[float, Report]]
    saving: tuple[str, ...] = ()
    unlucky: tuple[int, ...] = ()
    by_chance: bool = False

    def play(self, changes: Sequence[Change]) -> list[Verdict]:
        return [*map(self._verdict, changes)]

    def _verdict(self, change: Change) -> Verdict:
        given, seed = {each.key: float(each.value) for each in change.settings}, change.seed
        if self.by_chance and change == Change(seed=seed) and seed is not None:
            return Verdict("")
        for key, (least, report) in self.needed.items():
            saved = given.get(key, 0.0) >= least or {*map(str, change.settings)} & {*self.saving}
            if not saved or (seed in self.unlucky):
                return Verdict(f"FAILED {report.reason}", report)
        return Verdict("")

    def search(self) -> Saving:
        _, end = next(iter(self.needed.values()))
        return Search(ID, end, MoveForward(3.0), JACKAL, self.play, (1, 2, 3, 4)).run()


COMMAND = failed(Reason.OFF_COMMAND, "off_command")
OTHER = failed(Reason.LEAF_RAISED)


ONE = {"faults.off_command.above": (0.28, COMMAND)}


def test_the_minimal_factor_of_one_limit() -> None:
    found = Monitors(ONE).search()
    assert found.minimal == "faults.off_command.above=0.3 (recorded 0.15)"
    assert (found.saved, found.saved_unchanged, found.seeds) == (4, 0, 4)


def test_limits_that_end_a_run_one_after_the_other_are_changed_together() -> None:
    needed = {
        "faults.off_command.above": (0.2, COMMAND),
        "faults.tilt_limit.above": (0.6, failed(Reason.TILT_LIMIT, "tilt_limit")),
    }
    found = Monitors(needed).search()
    assert found.minimal == (
        "faults.off_command.above=0.225 (recorded 0.15),"
        " faults.tilt_limit.above=0.735 (recorded 0.49)"
    )


def test_a_speed_is_smaller_than_two_limits() -> None:
    needed = {
        "faults.off_command.above": (0.2, COMMAND),
        "faults.tilt_limit.above": (0.6, failed(Reason.TILT_LIMIT, "tilt_limit")),
    }
    found = Monitors(needed, ("drive.travel_speed=0.333333",)).search()
    assert found.minimal == "drive.travel_speed=0.333333 (recorded 1)"


def test_no_change_saves_a_run_that_the_next_reason_ends() -> None:
    needed = {"faults.off_command.above": (0.2, COMMAND), "another": (1.0, OTHER)}
    found = Monitors(needed).search()
    assert (found.minimal, found.instead) == ("", f"FAILED {Reason.LEAF_RAISED}")
    answer = SaveAnswer("run.mcap", "MOE:1", Fidelity.BIT_EQUAL, (), found)
    assert [*answer.lines()][1:3] == [
        "no change of limits, speeds, controller or arguments saves it",
        f"  with extreme limits: {found.instead}",
    ]


@pytest.mark.parametrize(("unlucky", "saved"), [((4,), 3), ((3, 4), 0)])
def test_a_change_that_saves_by_chance_is_not_named(unlucky: tuple[int, ...], saved: int) -> None:
    found = Monitors(ONE, unlucky=unlucky).search()
    assert (found.saved, not found.minimal) == (saved, saved == 0)


def test_a_change_is_not_named_that_saves_fewer_seeds_than_none() -> None:
    found = Monitors(ONE, unlucky=(4,), by_chance=True).search()
    assert (found.minimal, found.saved_unchanged) == ("", 4)
