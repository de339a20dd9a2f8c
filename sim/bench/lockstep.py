"""How much faster than real time the lock step runs, and whether it repeats."""

import tempfile
import time
from pathlib import Path

from executive.commands import Command, Identity, MoveForward, Request, RotateBy, TakePicture
from executive.reports import Stage
from executive.settings import Settings
from sim.bench.figures import Figure, Goal, quantile
from sim.camera import Backend, PictureSettings
from sim.lockstep import LockStep
from sim.world import World

RUNS = 5
LIMIT_S = 30.0
STEPS: tuple[Request, ...] = (MoveForward(3.0), RotateBy(1.570796), TakePicture())


def _play(settings: Settings) -> tuple[float, float, str]:
    """Drive 3 m, turn, take a picture: simulated seconds, real seconds, and all that was said."""
    began_s = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        picture = PictureSettings(width=160, height=120, backend=Backend.RAYS)
        lockstep = LockStep(settings, World(), Path(folder), seed=7, picture=picture)
        lockstep.run(0.5)
        for number, request in enumerate(STEPS, 1):
            identity = Identity("bench", number)
            lockstep.submit(Command(identity, request, "direct"))
            lockstep.run_until(lambda: _ended(lockstep), LIMIT_S)
        said = repr((lockstep.heard.reports, lockstep.rover.true_pose))
        lockstep.executive.ledger.close()
        return lockstep.time_s, time.perf_counter() - began_s, said


def _ended(lockstep: LockStep) -> bool:
    last = lockstep.heard.reports[-1]
    return last.stage is Stage.EXECUTED


def measure(settings: Settings) -> list[Figure]:
    """Return the figures of five runs, after one that is not counted."""
    _play(settings)
    runs = [_play(settings) for _ in range(RUNS)]
    factor = quantile([simulated_s / real_s for simulated_s, real_s, _ in runs], 0.5)
    alike = len({said for _, _, said in runs}) == 1
    scenario = "drive 3 m, turn, picture; real time; construction included"
    return [
        Figure("lock step, median speed", factor, "× real", scenario, Goal(50.0, at_least=True)),
        Figure("lock step, alike runs", RUNS if alike else 0, "runs", f"{RUNS} runs, bit for bit",
               Goal(RUNS, at_least=True)),
    ]  # fmt: skip
