"""kill -9 of a driving executive: time until it listens again, and until it accepts a command."""

import os
import socket
import time
from collections.abc import Callable
from random import Random

import psutil

from executive.commands.catalogue import DriveFor
from tests.benchmarks.octets import Octets
from tests.support.figures import Figure, Goal, cpu_s, quantile
from tests.support.patience import patient_config
from tests.support.ports import free_ports
from tests.support.victims import Victim, workplace

DRIVE = DriveFor(0.3, 0.2, 60.0)
"""A circle, so that the rover never leaves its ground."""
LIMIT_S = 30.0
POLL_S = 0.005
MAX_PAUSE_S = 2.5
LISTEN_S = 1.5
ACCEPT_S = 1.0
NONE = Goal(0)


def measure(kills: int, seed: int, log: Callable[[str], None]) -> list[Figure]:
    """Kill the executive of a simulated rover, and start it again at once, for each of `kills`.

    Raises:
        ChildError: a process ended by itself.
        TimeoutError: the executive does not listen, or accepts nothing.
    """
    random = Random(seed)
    listening, computing, accepting = list[float](), list[float](), list[float]()
    (port,) = free_ports(1)
    with workplace() as workspace:
        workspace.environment["ROVER_CONFIG"] = str(patient_config(workspace.folder))
        workspace.start("simulation", "sim.ros.process", "--world", "flat", "--camera", "off")
        executive = workspace.start(
            "executive", "adapters.onboard.process",
            "--port", port, "--data", workspace.folder / "data",
        )  # fmt: skip
        executive.wait()
        _until_accepted(executive, port)
        for number in range(1, kills + 1):
            time.sleep(random.uniform(0.1, MAX_PAUSE_S))
            began_s = time.monotonic()
            executive.restart()
            listens_s = _until_listening(executive, port)
            computing.append(cpu_s(psutil.Process(executive.child.pid)))
            refused = _until_accepted(executive, port)
            accepted_s = time.monotonic()
            listening.append(listens_s - began_s)
            accepting.append(accepted_s - listens_s)
            log(
                f"kill {number}: listens after {listening[-1]:.2f} s, accepts {accepting[-1]:.3f} s"
                f" later, {refused} refused, load {os.getloadavg()[0]:.1f}"
            )
    late = sum(delay_s > ACCEPT_S for delay_s in accepting)
    beside = f"{kills} kills while driving, seed {seed}"
    return [
        Figure("kill to listening, median", quantile(listening, 0.5), "s", beside, Goal(LISTEN_S)),
        Figure("kill to listening, max", max(listening), "s", beside),
        Figure("kill to listening, CPU, median", quantile(computing, 0.5), "s", beside),
        Figure("listening to accepted, median", quantile(accepting, 0.5), "s", beside),
        Figure("listening to accepted, max", max(accepting), "s", beside),
        Figure(f"accepted later than {ACCEPT_S:g} s", late, "kills", beside, NONE),
    ]


def _until_listening(executive: Victim, port: int) -> float:
    """Return when a connection was accepted for the first time, by `time.monotonic`."""
    deadline_s = time.monotonic() + LIMIT_S
    while time.monotonic() < deadline_s:
        try:
            socket.create_connection(("127.0.0.1", port), timeout=LIMIT_S).close()
        except ConnectionRefusedError:
            executive.child.check()
            time.sleep(POLL_S)
        else:
            return time.monotonic()
    raise TimeoutError("the executive does not listen")


def _until_accepted(executive: Victim, port: int) -> int:
    """Send new commands until one is accepted; return how many were refused."""
    deadline_s, refused = time.monotonic() + LIMIT_S, 0
    with Octets(port) as commands:
        while not commands.request(DRIVE):
            refused += 1
            executive.child.check()
            if time.monotonic() > deadline_s:
                lines = executive.child.log.read_text().splitlines()
                last = "\n".join([each for each in lines if "EVENT" in each] + lines[-1:])
                raise TimeoutError(f"the executive accepts no command:\n{last}")
            time.sleep(POLL_S)
    return refused
