"""What the executive's process costs, beside a bare rclpy node on the same topics."""

import time

import psutil

from executive.commands import DriveFor
from tests.benchmarks.onboard import Octets, stand_in
from tests.benchmarks.processes import Bench, port_of
from tests.support.figures import Figure, Goal

SETTLE_S = 3.0
MB = 1e6


def measure(duration_s: float = 20.0) -> list[Figure]:
    """Return CPU and memory of both, driving, with 50 Hz odometry and 20 velocities a second."""
    with (
        Bench() as bench,
        bench.started(
            "executive", "adapters.onboard.process", "--port", "0", "--data", str(bench.folder)
        ) as executive,
        bench.started(
            "bare", "tests.benchmarks.bare_node", "--ros-args", "-r", "cmd_vel:=bare_cmd_vel"
        ) as bare,
        stand_in(bench.domain) as rover,
    ):
        commands = Octets(port_of(executive))
        deadline_s = time.monotonic() + duration_s
        while not rover.moving.wait(0.2) and time.monotonic() < deadline_s:
            commands.send(commands.message(DriveFor(0.5, 0.1, 60.0)))
            commands.reply()
        time.sleep(SETTLE_S)
        measured = [psutil.Process(executive.pid), psutil.Process(bare.pid)]
        before = [_cpu_s(process) for process in measured]
        time.sleep(duration_s)
        ours, theirs = (
            100 * (_cpu_s(process) - began) / duration_s
            for process, began in zip(measured, before, strict=True)
        )
        resident_mb = [process.memory_info().rss / MB for process in measured]
        commands.close()
    beside = "bare rclpy node, same topics, same run"
    return [
        Figure("executive, CPU", ours, "%", beside),
        Figure("bare node, CPU", theirs, "%", "of one core"),
        Figure("executive over bare node, CPU", ours / theirs, "ratio", beside, Goal(1.5)),
        Figure("executive, resident memory", resident_mb[0], "MB", "no simulation", Goal(85.0)),
        Figure("bare node, resident memory", resident_mb[1], "MB", beside),
    ]


def _cpu_s(process: psutil.Process) -> float:
    times = process.cpu_times()
    return float(times.user + times.system)
