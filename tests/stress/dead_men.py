"""kill -9 for who commands a rover, at random moments of its motions: how soon does it stand?

MOCUP is moved by `rover-executive`, `rover-nxt` and the program of its brick, in this order; the
Jackal by `rover-executive` and its base. What was killed is started again for the next round.
"""

import asyncio
import time
from collections.abc import Sequence
from enum import Enum, unique
from functools import partial
from math import hypot
from random import Random
from typing import Final

from adapters.mrs.ground import MrsClient
from adapters.mrs.spec.types import Stage
from adapters.mrs.transport import NAME
from executive.commands import (
    DriveFor,
    MoveForward,
    Request,
    Resume,
    RotateBy,
    SetRotateSpeed,
    SetTravelSpeed,
    Stop,
)
from executive.values.geometry import wrap_rad
from sim.processes import HOST
from tests.stress.findings import Log
from tests.stress.pose_log import TruePose, read_poses
from tests.support.figures import Figure, Goal, quantile
from tests.support.ground import call_ground, located
from tests.support.ports import free_ports
from tests.support.victims import Victim, Workplace, workplace

FASTEST_MPS: Final = {"mocup": 0.2, "jackal": 1.0}
STATIONARY_WITHIN_S: Final = {"mocup": 1.2, "jackal": 0.3}
MAX_WAIT_S: Final = 2.0
"""Of a round: from the start of its motion to the kill."""
WATCHED_S: Final = 3.0
"""After a kill."""
STILL_M: Final = 0.005
STILL_RAD: Final = 0.01
"""A rover that is nearer to where it came to stand stands."""


@unique
class Target(Enum):
    """What is killed, by the names of the processes."""

    EXECUTIVE = ("executive",)
    NXT = ("nxt",)
    BOTH = ("executive", "nxt")

    def __str__(self) -> str:
        return " and ".join(self.value)


def measure(kills: int, seed: int, log: Log) -> list[Figure]:
    """Return after how long rovers stand.

    Args:
        kills: how many of each kind.
        seed: of the moments, and of what is commanded.
        log: called with a line on each kill.

    Raises:
        ChildError: a process ended by itself.
        TimeoutError: the processes did not start.
    """
    figures = []
    for asset, targets in (("mocup", tuple(Target)), ("jackal", (Target.EXECUTIVE,))):
        for target, standstill_s in kill_in_motion(asset, targets, kills, seed, log).items():
            name, beside = f"{asset}, {target} killed: stands", f"{kills} kills, seed {seed}"
            goal = Goal(STATIONARY_WITHIN_S[asset])
            figures += [
                Figure(f"{name}, median", quantile(standstill_s, 0.5), "s", beside),
                Figure(f"{name}, at most", max(standstill_s), "s", beside, goal),
            ]
    return figures


def kill_in_motion(
    asset: str, targets: Sequence[Target], kills: int, seed: int, log: Log
) -> dict[Target, list[float]]:
    """Return after how many seconds a rover stood, for each kill of each target."""
    standstill_s: dict[Target, list[float]] = {target: [] for target in targets}
    random = Random(seed)
    rounds = [*targets] * kills
    random.shuffle(rounds)
    with workplace() as workspace:
        observer = workspace.start("observer", "tests.stress.pose_log", asset)
        victims, uri = _start(workspace, asset, seed)
        for number, target in enumerate(rounds):
            workspace.check()
            for victim in victims.values():
                victim.wait()
            call_ground(uri, partial(_begin, asset=asset, direction=(-1) ** number, random=random))
            time.sleep(random.uniform(0.0, MAX_WAIT_S))
            killed_s = time.time()
            for name in target.value:
                victims[name].child.kill()
            time.sleep(WATCHED_S)
            standstill_s[target].append(
                _stationary_after_s(read_poses(observer.child.log), killed_s)
            )
            log(f"{asset}, {target} killed: stands after {standstill_s[target][-1]:.2f} s")
            for name in target.value:
                victims[name].start()
    return standstill_s


def _start(workspace: Workplace, asset: str, seed: int) -> tuple[dict[str, Victim], str]:
    (port,) = free_ports(1)
    cable = ("--usb-socket", workspace.folder / "usb") if asset == "mocup" else ()
    workspace.start(
        "simulation", "sim.ros.process",
        "--asset", asset, "--world", "flat", "--seed", seed, "--camera", "off", *cable,
        up="stands in world",
    ).wait()  # fmt: skip
    victims = {
        "executive": workspace.start(
            "executive", "adapters.onboard.process",
            "--asset", asset, "--port", port, "--data", workspace.folder / "aboard",
        )
    }  # fmt: skip
    if cable:
        data = ("--data", workspace.folder / "brick")
        line = ("sim.brick.nxt", "--asset", asset, *data, *cable)
        victims["nxt"] = workspace.start("nxt", *line, up="brick connected")
    return victims, f"maltcp://{HOST}:{port}/{NAME}"


async def _begin(client: MrsClient, asset: str, direction: int, random: Random) -> None:
    """Begin a motion that lasts, at full speed, and return when it has started."""
    await located(client)
    speed_mps = FASTEST_MPS[asset]
    motions: tuple[Request, ...] = (
        MoveForward(direction * 8 * speed_mps),
        RotateBy(direction * 3.0),
        DriveFor(direction * speed_mps, 0.2, 8.0),
    )
    # a stop first: what the last round left under way is over, and so is what comes of it
    for request in (Stop(), Resume(), SetTravelSpeed(speed_mps), SetRotateSpeed(0.5)):
        await client.run(client.command(request))
    started = asyncio.Event()
    motion = asyncio.create_task(
        client.run(
            client.command(random.choice(motions)),
            lambda reported: started.set() if reported.report.stage is Stage.STARTED else None,
        )
    )
    waiting = asyncio.create_task(started.wait())
    done, _ = await asyncio.wait((motion, waiting), return_when=asyncio.FIRST_COMPLETED)
    if motion in done:
        raise TimeoutError(f"the motion ended before it was killed: {motion.result()}")
    motion.cancel()


def _stationary_after_s(poses: Sequence[TruePose], killed_s: float) -> float:
    """Return how long after a kill the rover was still away from where it came to stand."""
    seen = [pose for pose in poses if pose.utc_s > killed_s]
    last = seen[-1]
    away = [
        pose.utc_s
        for pose in seen
        if hypot(pose.x_m - last.x_m, pose.y_m - last.y_m) > STILL_M
        or abs(wrap_rad(pose.heading_rad - last.heading_rad)) > STILL_RAD
    ]
    return max(away, default=killed_s) - killed_s
