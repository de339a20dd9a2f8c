"""Random commands, repeats, late arrivals, crashes: the promises that hold whatever comes."""

import tempfile
from collections import Counter
from collections.abc import Sequence
from math import inf, nan
from pathlib import Path
from random import Random

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    invariant,
    rule,
    run_state_machine_as_test,
)

from executive.commands import (
    Arrival,
    Command,
    DriveFor,
    FollowPath,
    Identity,
    MoveForward,
    MoveTo,
    Request,
    Resume,
    RotateBy,
    SetCameraAngles,
    SetTravelSpeed,
    Stop,
    TakePicture,
    Waypoint,
)
from executive.geometry import STANDING
from executive.reports import Report, Stage
from tests.support.kinematic import Bench

FIGURES = (nan, inf, -0.0, 1e9)


def near(random: Random) -> float:
    return random.choice(FIGURES) if random.random() < 0.02 else random.uniform(-3.0, 3.0)


def waypoint(random: Random) -> Waypoint:
    return Waypoint(near(random), near(random), random.choice((None, near(random))))


def request(random: Random) -> Request:
    ask = random.choice(
        (
            lambda: MoveTo(waypoint(random)),
            lambda: MoveForward(near(random)),
            lambda: RotateBy(near(random)),
            lambda: DriveFor(near(random) / 3, near(random) / 2, abs(near(random))),
            lambda: FollowPath(tuple(waypoint(random) for _ in range(random.randrange(4)))),
            lambda: SetTravelSpeed(near(random)),
            lambda: SetCameraAngles(near(random), random.choice((None, near(random)))),
            TakePicture,
            Stop,
            Resume,
            Resume,
        )
    )
    return ask()


def command(random: Random, utc_s: float) -> Command:
    return Command(
        Identity(random.choice(("MOE", "MOPS")), random.randrange(100_000)),
        request(random),
        random.choice(("direct", "relay")),
        created_utc_s=utc_s,
        lifetime_s=random.choice((None, None, random.uniform(0.0, 5.0))),
        arrival=random.choice(tuple(Arrival)),
    )


class Storm(RuleBasedStateMachine):
    """Two links, one rover."""

    commands = 0

    def __init__(self) -> None:
        super().__init__()
        self._folder = tempfile.TemporaryDirectory()
        self.bench = Bench(Path(self._folder.name))
        self.sent: list[Command] = []
        self.held_back: list[Command] = []

    @rule(random=st.randoms(use_true_random=True), count=st.integers(1, 50))
    def commands_come(self, random: Random, count: int) -> None:
        for _ in range(count):
            match random.randrange(5):
                case 0:
                    self.held_back.append(command(random, self.bench.clock.utc_s()))
                case 1 if self.held_back:
                    self.deliver(self.held_back.pop(random.randrange(len(self.held_back))))
                case 2 if self.sent:
                    self.deliver(random.choice(self.sent))
                case _:
                    self.deliver(command(random, self.bench.clock.utc_s()))
            if random.random() < 0.2:
                self.bench.step()

    def deliver(self, command: Command) -> None:
        type(self).commands += 1
        self.bench.send(command)
        self.sent.append(command)

    @rule(ticks=st.integers(1, 40))
    def let_time_pass(self, ticks: int) -> None:
        for _ in range(ticks):
            held = self.bench.executive.context.latches.held
            self.bench.step()
            if held and self.bench.executive.context.latches.held:
                assert self.bench.rover.velocity == STANDING

    @rule()
    def crash(self) -> None:
        self.bench.crash()
        assert self.bench.rover.velocity == STANDING
        assert list(self.bench.executive.ledger.unfinished()) == []

    @rule(works=st.booleans())
    def odometry(self, works: bool) -> None:
        self.bench.odometry = works

    @invariant()
    def nothing_moves_while_stopped_or_safe(self) -> None:
        if self.bench.executive.context.latches.held:
            assert self.bench.rover.velocity == STANDING

    def teardown(self) -> None:
        self.bench.odometry = True
        self.bench.run(0.2)
        self.bench.send(Command(Identity("end", 1), Stop(), "direct"))
        self.bench.run(6.0)
        self.check_reports(self.bench.executive.ledger.reports(count=1_000_000))
        self.bench.executive.ledger.close()
        self._folder.cleanup()

    @staticmethod
    def check_reports(reports: Sequence[Report]) -> None:
        assert [report.sequence for report in reports] == list(range(1, len(reports) + 1))
        stages = Counter(
            (report.identity, report.stage)
            for report in reports
            if report.identity is not None and report.stage is not None
        )
        ends: Counter[Identity] = Counter()
        for (identity, stage), count in stages.items():
            assert count == 1 or stage is Stage.PROGRESS, (identity, stage, count)
            if stage.terminal:
                ends[identity] += count
        assert ends == Counter({identity: 1 for identity, _ in stages})


def storm(examples: int) -> int:
    Storm.commands = 0
    run_state_machine_as_test(
        Storm,
        settings=settings(
            max_examples=examples,
            stateful_step_count=30,
            deadline=None,
            derandomize=True,
            database=None,
            suppress_health_check=list(HealthCheck),
        ),
    )
    return Storm.commands


def test_promises_hold_in_a_storm() -> None:
    assert storm(examples=20) > 1_000


@pytest.mark.slow
def test_promises_hold_in_a_storm_of_a_hundred_thousand_commands() -> None:
    assert storm(examples=700) >= 100_000
