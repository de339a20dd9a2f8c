"""From the octets of a stop to zero on cmd_vel, above what a bare echo takes."""

import random
import time

from executive.commands import DriveFor, Resume, Stop
from tests.benchmarks.large_tree import TREE_NODES
from tests.benchmarks.onboard import Octets, StandIn, stand_in
from tests.benchmarks.processes import Bench, port_of
from tests.support.figures import Figure, Goal, quantile

WARM_UP = 10
ANSWER_S = 10.0
MS = 1000.0


def measure(samples: int = 300) -> list[Figure]:
    """Return the figures of stops and echoes taken in turn, in one run."""
    with (
        Bench() as bench,
        bench.started("executive", "tests.benchmarks.large_tree", str(bench.folder)) as executive,
        bench.started("echo", "tests.benchmarks.bare_echo") as echo,
        stand_in(bench.domain) as rover,
    ):
        commands, echoes = Octets(port_of(executive)), Octets(port_of(echo))
        _wait_until_driven(commands, rover)
        _wait_until_echoed(echoes, rover)
        chance = random.Random(1)
        stops_ms, echoes_ms = [], []
        for sample in range(WARM_UP + samples):
            stop_s = _stop(commands, rover, chance)
            echo_s = _echo(echoes, rover)
            if sample >= WARM_UP:
                stops_ms.append(MS * stop_s)
                echoes_ms.append(MS * echo_s)
        commands.close()
        echoes.close()
    beside = f"{samples} stops while moving, tree of {TREE_NODES} nodes"
    above = "bare MAL-in, ROS-out echo, in turn"
    figures = []
    for name, ratio, goal in (("median", 0.5, 1.0), ("p99", 0.99, 5.0)):
        stop_ms, echo_ms = quantile(stops_ms, ratio), quantile(echoes_ms, ratio)
        figures += [
            Figure(f"stop to zero, {name}", stop_ms, "ms", beside),
            Figure(f"echo, {name}", echo_ms, "ms", above),
            Figure(f"stop above echo, {name}", stop_ms - echo_ms, "ms", above, Goal(goal)),
        ]
    return figures


def _wait_until_driven(commands: Octets, rover: StandIn) -> None:
    """Drive for the first time: until odometry and velocities find their way, that is refused."""
    deadline_s = time.monotonic() + ANSWER_S
    while not rover.moving.wait(0.2):
        if time.monotonic() > deadline_s:
            raise TimeoutError("the executive does not drive")
        _send(commands, DriveFor(0.5, 0.0, 60.0))


def _wait_until_echoed(echoes: Octets, rover: StandIn) -> None:
    """Have an echo heard for the first time: until its topic is found, it is lost."""
    deadline_s = time.monotonic() + ANSWER_S
    rover.expect_zero("echo")
    while not rover.zero_came("echo", 0.2):
        if time.monotonic() > deadline_s:
            raise TimeoutError("the echo is not heard")
        echoes.send(echoes.message(Stop()))


def _stop(commands: Octets, rover: StandIn, chance: random.Random) -> float:
    """Stop the moving rover at a random moment of its tick, set off again; return the delay."""
    message = commands.message(Stop())
    time.sleep(chance.uniform(0.0, 0.06))
    rover.expect_zero("jackal")
    began_s = time.perf_counter()
    commands.send(message)
    delay_s = rover.wait_zero("jackal", ANSWER_S) - began_s
    commands.reply()
    _send(commands, Resume())
    _send(commands, DriveFor(0.5, 0.0, 60.0))
    if not rover.moving.wait(ANSWER_S):
        raise TimeoutError("the executive does not drive after a stop")
    return delay_s


def _echo(echoes: Octets, rover: StandIn) -> float:
    """Have a stop echoed; return the delay."""
    message = echoes.message(Stop())
    rover.expect_zero("echo")
    began_s = time.perf_counter()
    echoes.send(message)
    return rover.wait_zero("echo", ANSWER_S) - began_s


def _send(commands: Octets, request: DriveFor | Resume) -> None:
    commands.send(commands.message(request))
    commands.reply()
