"""Robots of other makers, driven by an executive that knows them by their configuration alone."""

import os
import re
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import pi, remainder, tau
from pathlib import Path
from typing import Final

import pytest
from std_srvs.srv import Trigger

from adapters.mrs.ground import CommandOutcome
from adapters.ros import ros_node, single_threaded
from executive.commands import Request
from executive.commands.catalogue import (
    DriveFor,
    FollowPath,
    MoveForward,
    MoveTo,
    Resume,
    RotateBy,
    Stop,
    TakePicture,
    Waypoint,
)
from executive.settings import Controller
from tests.robots.interfaces import INTERFACES
from tests.suite import CHECKOUT
from tests.support.ground import carry_out, until_located
from tests.support.processes import LISTENS, Running

pytestmark = [pytest.mark.busy, pytest.mark.ros, pytest.mark.slow]

SPEED: Final = 4.0
"""At most: a stand-in that is driven waits for each velocity, however long the machine takes."""
SLOW_REST: Final = ("--rest-speed", "0.4")
"""Odometry that a busy machine delivers 0.3 s late is then less than 0.15 s old."""
LIMIT_S: Final = 60.0
TURN: Final = DriveFor(0.0, 0.5, 1.0)
PATH: Final = ((0.7, 0.9), (0.3, 0.9), (0.0, 0.6))
POSITION_M, HEADING_RAD = 0.05, pi / 60


@dataclass(frozen=True, slots=True)
class Case:
    """A robot, how far it drives backward in the end, and what it refuses."""

    name: str
    backward_m: float = 0.5
    refused: tuple[Request, ...] = ()


ROBOTS: Final = (
    Case("clearpath_j100"),
    Case("turtlebot4", backward_m=0.3),
    Case("panther"),
    Case("rosbot_xl"),
    Case("leo"),
    Case("turtlebot3"),
    Case("ackermann", refused=(MoveTo(Waypoint(0.0, 2.0), Controller.TURN_DRIVE), TURN)),
    Case("j100_wheels"),
    Case("tracked"),
)
IN_SUITE: Final = 3
"""Each takes 7 s: the others are played with ROBOTS=all, as `rover test --stress` does."""


@contextmanager
def module(log: Path, name: str, *arguments: str) -> Iterator[Running]:
    """Run a module of this checkout as a process."""
    process = Running(log, sys.executable, "-m", name, *arguments, cwd=CHECKOUT)
    try:
        yield process
    finally:
        process.clean_up()


@contextmanager
def executive(folder: Path, name: str, asset: Path | None = None) -> Iterator[tuple[Running, str]]:
    """Run the executive of a robot, with its shipped asset or another."""
    robot = INTERFACES[name]
    ros = ["--ros-args", "-p", "use_sim_time:=true"]
    if robot.namespace:
        ros += ["-r", f"__ns:=/{robot.namespace}"]
    options = ("--port", "0", "--asset", str(asset or f"robots/{name}"))
    data = ("--data", str(folder / "data"))
    log = folder / "executive.log"
    with module(log, "adapters.onboard.process", *options, *data, *ros) as process:
        yield process, process.output(LISTENS)


def call(name: str, service: str) -> None:
    """Call a service of a robot."""
    with ros_node("operator", name) as node, single_threaded(node) as executor:
        client = node.create_client(Trigger, service)
        deadline_s = time.monotonic() + LIMIT_S
        while not client.service_is_ready():
            assert time.monotonic() < deadline_s, f"no {service}"
            executor.spin_once(timeout_sec=0.05)
        future = client.call_async(Trigger.Request())
        executor.spin_until_future_complete(future, timeout_sec=LIMIT_S)
        assert future.result().success  # type: ignore[no-untyped-call]


def resume(uri: str) -> None:
    """Resume, as soon as the executive knows of the release."""
    deadline_s = time.monotonic() + LIMIT_S
    while refused := failures(carry_out(uri, Resume())):
        assert time.monotonic() < deadline_s, refused


def session(case: Case) -> tuple[Request, ...]:
    robot = INTERFACES[case.name]
    return (
        MoveForward(1.0),
        RotateBy(pi / 2),
        MoveTo(Waypoint(1.0, 0.6)),
        FollowPath((*(Waypoint(*each) for each in PATH[:-1]), Waypoint(*PATH[-1], pi))),
        *(() if robot.camera is None else (TakePicture(),)),
        MoveForward(-case.backward_m),
    )


def failures(outcomes: list[CommandOutcome]) -> list[str]:
    return [
        f"{outcome.command.request}: {outcome.refusal or outcome.reports[-1].text}"
        for outcome in outcomes
        if not outcome.executed
    ]


def where(text: str) -> tuple[float, float, float]:
    found = re.search(r"odometry: (\S+) m, (\S+) m, (\S+) deg", text)
    assert found is not None, text
    x_m, y_m, heading_deg = map(float, found.groups())
    return x_m, y_m, heading_deg * pi / 180


PLAYED: Final = ROBOTS if os.environ.get("ROBOTS") == "all" else ROBOTS[:IN_SUITE]


@pytest.mark.parametrize("case", PLAYED, ids=lambda case: case.name)
def test_a_robot_is_driven_by_configuration_alone(
    case: Case, ros_domain: int, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    assert ros_domain > 0
    monkeypatch.setenv("PYTHONPATH", str(CHECKOUT))
    robot = INTERFACES[case.name]
    standin = ("tests.robots.standin", case.name, "--speed", str(SPEED), *SLOW_REST)
    with module(tmp_path / "robot.log", *standin) as process:
        process.output("is there")
        with executive(tmp_path, case.name) as (onboard, uri):
            until_located(uri)
            stop = robot.emergency_stop
            if stop is not None and stop.at_start:
                onboard.output("emergency stop of the robot is active")
                assert "release it there" in "".join(failures(carry_out(uri, MoveForward(1.0))))
                call(case.name, stop.reset)
                resume(uri)
                carry_out(uri, Stop())
                process.output("stopped by its service")
                resume(uri)
            for each in case.refused:
                assert "cannot turn at less than" in "".join(failures(carry_out(uri, each)))
            assert failures(carry_out(uri, *session(case))) == [], onboard.text
            assert onboard.end() == 0
        process.end()
        x_m, y_m, heading_rad = where(process.text)
    assert (x_m, y_m) == pytest.approx((case.backward_m, PATH[-1][1]), abs=POSITION_M)
    assert remainder(heading_rad - pi, tau) == pytest.approx(0.0, abs=HEADING_RAD)
