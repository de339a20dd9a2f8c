"""How soon a stop acts, whatever else the executive is made to do.

this process ── stop ──▶ executive ── cmd_vel ──▶ simulation
load (others' octets) ──▶            └──▶ witness ◀── true odometry
"""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from random import Random
from statistics import mean
from typing import Final

from executive.commands.catalogue import (
    AbortPlan,
    ActivatePlan,
    DriveFor,
    MoveForward,
    PlanDefinition,
    RemovePlan,
    Resume,
    Stop,
    SubmitPlan,
)
from executive.settings import SettingsError
from tests.benchmarks import stop_load, stop_witness
from tests.benchmarks.large_tree import HANG
from tests.benchmarks.octets import Octets
from tests.stress.small_disk import NoDiskError, small_disk
from tests.support.figures import Figure, Goal, quantile
from tests.support.victims import Victim, Workplace, workplace

P99_MS: Final = 20.0
MAX_MS: Final = 50.0
LIMIT_S: Final = 10.0
"""A stop that does not act for so long counts as one that does not."""
START_S: Final = 30.0
POLL_S: Final = 0.01
PHASE_S: Final = 0.06
"""Of a tick and more, so that stops meet it anywhere."""
HANGS_S: Final = 5.0
SAME_NUMBER: Final = 1
LARGE_OCTETS: Final = 50_000_000
SPEED_MPS: Final = 0.5
SETTINGS, TIMES = 480, 20
PLAN: Final = f"""<root BTCPP_format="4"><BehaviorTree ID="Main">
<Timeout msec="60000"><Parallel><moveForward distance="20"/>
<Sequence><setCameraAngles pan="{{pan}}" tilt="0"/><Repeat num_cycles="{TIMES}"><Parallel>
{'<setTravelSpeed speed="0.5"/>' * SETTINGS}
</Parallel></Repeat></Sequence></Parallel></Timeout></BehaviorTree></root>"""
"""The camera turns a little first, so that the rover is at speed when the settings come."""
HELD_S: Final = 1.0
"""For which a rover has to stand against another publisher; inputs of the mux end after 0.5 s."""
STATIONARY_S: Final = 0.5
_TRUE: Final = {stop_witness.STATIONARY, stop_witness.MOVES, stop_witness.ROLLS}
Log = Callable[[str], object]


class Rig:
    """A rover that drives, its executive, and who sees what becomes of stops.

    Attributes:
        data: folder of the executive.
    """

    def __init__(self, workspace: Workplace, data: Path) -> None:
        self.position, self.data = workspace, data
        (data / "files").mkdir(parents=True)
        workspace.start("simulation", "sim.ros.process", "--world", "flat", "--camera", "off")
        self.executive = workspace.start("executive", "tests.benchmarks.large_tree", data)
        self._witness = workspace.start(
            "witness", "tests.benchmarks.stop_witness", up=stop_witness.WATCHES
        )
        self._random, self._plans = Random(1), 0
        for each in (self.executive, self._witness):
            each.wait()
        self.commands = Octets(self.executive.port(), "MOE")

    def load(self, kind: str) -> Victim:
        """Start a load and wait until it is on."""
        workspace = self.position
        load = workspace.start(
            "load", "tests.benchmarks.stop_load", kind, self.executive.port(), workspace.folder,
            up=stop_load.LOADS,
        )  # fmt: skip
        load.wait()
        return load

    def restart(self) -> None:
        """Kill the executive, and start it again on what it has left."""
        self.commands.close()
        self.executive.restart()
        self.commands = Octets(self.executive.port(), "MOE")

    def close(self) -> None:
        self.commands.close()

    def drive(self) -> None:
        """Resume and drive; raises TimeoutError if the rover cannot be brought to move."""
        self._insist(lambda: self.commands.request(DriveFor(SPEED_MPS, 0.3, 60.0)))

    def run_plan(self) -> None:
        """Drive by a plan that also changes settings all the time."""

        def start() -> None:
            for old in (AbortPlan, RemovePlan):
                self.commands.request(old(f"load-{self._plans}"))
            self._plans += 1
            plan_id = f"load-{self._plans}"
            text = PLAN.replace("{pan}", ("0.2", "-0.2")[self._plans % 2])
            plan = PlanDefinition(plan_id, "load", "BTCPP4", text.encode())
            self.commands.request(SubmitPlan(plan))
            self.commands.request(ActivatePlan(plan_id))

        self._insist(start)

    def hang(self) -> None:
        """Drive, and have the tree's tick not return for a while."""
        self.drive()
        (self.data / HANG).write_text(str(HANGS_S))
        while (self.data / HANG).exists():
            time.sleep(POLL_S)

    def stop(self, number: int | None = None, phase_s: float = PHASE_S) -> tuple[float, float]:
        """Stop; return after how many seconds zero is commanded, and the rover stands.

        Args:
            number: of the stop; None for a new one.
            phase_s: how long the rover goes on before that, at most.
        """
        message = self.commands.command(Stop(), number)
        time.sleep(self._random.uniform(0.0, phase_s))
        began_s = time.perf_counter()
        self.commands.send(message)
        # Looking for news all the time would take from the time of the rover's processes.
        self.commands.reply()
        zero_s = self._seen(stop_witness.ZERO, stop_witness.DRIVEN, LIMIT_S)
        stationary_s = self._seen(stop_witness.STATIONARY, stop_witness.ROLLS, LIMIT_S)
        return max(0.0, zero_s - began_s), max(0.0, stationary_s - began_s)

    def release(self) -> None:
        """Resume, and wait until somebody else drives the rover."""
        self._insist(lambda: None, by_others=True)

    def stop_for_good(self) -> float:
        """Stop; return after how many seconds the rover stands, and goes on standing."""
        message = self.commands.command(Stop())
        time.sleep(self._random.uniform(0.0, PHASE_S))
        began_s = time.perf_counter()
        self.commands.send(message)
        self.commands.reply()
        while time.perf_counter() < began_s + LIMIT_S:
            time.sleep(POLL_S)
            word, at_s = next((each for each in self._changes() if each[0] in _TRUE), ("", 0.0))
            if word == stop_witness.STATIONARY and time.perf_counter() - at_s > HELD_S:
                return max(0.0, at_s - began_s)
        return math.inf

    def _insist(self, start: Callable[[], object], by_others: bool = False) -> None:
        deadline_s = time.monotonic() + START_S
        while time.monotonic() < deadline_s:
            self.commands.request(Resume())
            start()
            # The witness, too, has to have found an executive that was started again.
            rolls_s = self._seen(stop_witness.ROLLS, stop_witness.STATIONARY, 1.0)
            if math.isfinite(rolls_s) and (
                by_others or math.isfinite(self._seen(stop_witness.DRIVEN, stop_witness.ZERO, 1.0))
            ):
                return
            self.position.check()
        raise TimeoutError("the executive does not drive")

    def _seen(self, wanted: str, other: str, limit_s: float) -> float:
        """Wait until one change is later than another; return when it came, or infinity."""
        deadline_s = time.monotonic() + limit_s
        while time.monotonic() < deadline_s:
            word, at_s = next(
                (each for each in self._changes() if each[0] in (wanted, other)), ("", 0.0)
            )
            if word == wanted:
                return at_s
            time.sleep(POLL_S)
        return math.inf

    def _changes(self) -> Iterator[tuple[str, float]]:
        """Return what the witness saw, the newest first."""
        for line in reversed(self._witness.child.log.read_text(encoding="utf-8").split("\n")[:-1]):
            word, _, at_s = line.partition(" ")
            yield word, float(at_s or "nan")


@dataclass(frozen=True, slots=True)
class Condition:
    """What is going on while stops come, and how often.

    Attributes:
        share: of the stops asked for.
        load: kind of load.
        move: brings the rover to move.
        number: of every stop; None for a new one each time.
        phase_s: how long the rover goes on before a stop, at most.
    """

    name: str
    share: float = 1.0
    load: str = ""
    move: Callable[[Rig], None] = Rig.drive
    number: int | None = None
    phase_s: float = PHASE_S


def conditions() -> dict[str, Condition]:
    """Return the conditions by their short names."""
    return {
        "nothing": Condition("nothing else"),
        "fetch": Condition("50 MB fetched", load="fetch"),
        "commands": Condition("1200 commands/s", load="command"),
        "connections": Condition("1500 connections", load="connect"),
        "large": Condition("messages of 1 MB, 250,000 elements", load="send_large"),
        "plan": Condition("a plan of 480 settings × 20", 0.3, move=Rig.run_plan, phase_s=3.0),
        "registrations": Condition("10,200 registrations, never read", load="register"),
        "hang": Condition("a tick that hangs 5 s", 0.1, move=Rig.hang),
        "repeated": Condition("repeated numbers", 10.0, number=SAME_NUMBER),
    }


FULL_DISK: Final = "disk"
OTHERS: Final = {"external": Rig.drive, "joystick": Rig.release}
"""Who else publishes velocities, by the input of the mux, and how the rover comes to move then."""
NAMES: Final = (*conditions(), FULL_DISK, *OTHERS)
FAILURES: Final = 3
"""Stops that do not act, after which no more are sent under that condition."""
RESTARTS: Final = 5


def measure(samples: int, names: Sequence[str], log: Log) -> list[Figure]:
    """Return how soon stops act under each condition.

    Args:
        samples: stops for a condition; a few take a part of it, repeated numbers ten times as many.
        names: short names of the conditions; none for all.
        log: called with a line on each condition.

    Raises:
        SettingsError: there is no such condition.
    """
    if unknown := set(names) - set(NAMES):
        raise SettingsError(f"--while {min(unknown)}: one of {', '.join(NAMES)}")
    figures = []
    for name in names or NAMES:
        with ExitStack() as stack:
            workspace = stack.enter_context(workplace())
            if name == FULL_DISK:
                figures += _on_a_full_disk(workspace, stack, log)
            else:
                rig = stack.enter_context(closing(Rig(workspace, workspace.folder / "data")))
                if name in OTHERS:
                    figures += _against(name, rig, samples, log)
                    continue
                figures += _under(conditions()[name], rig, samples, log)
    return figures


def _under(condition: Condition, rig: Rig, samples: int, log: Log) -> list[Figure]:
    if condition.load == "fetch":
        (rig.data / "files" / stop_load.FILE).write_bytes(bytes(LARGE_OCTETS))
    rig.drive()
    rig.stop()
    load = rig.load(condition.load) if condition.load else None
    taken, wanted = list[tuple[float, float]](), max(FAILURES, round(condition.share * samples))
    for _ in range(wanted):
        condition.move(rig)
        taken.append(rig.stop(condition.number, condition.phase_s))
        rig.position.check()
        if sum(math.isinf(zero_s) for zero_s, _ in taken) == FAILURES:
            break
    rates = load.child.log.read_text(encoding="utf-8").split(stop_load.RATE)[1:] if load else []
    beside = f"; load {mean(float(each.split()[0]) for each in rates):.0f}/s" if rates else ""
    return _figures(condition.name, taken, beside, log)


def _on_a_full_disk(workspace: Workplace, stack: ExitStack, log: Log) -> list[Figure]:
    try:
        disk = stack.enter_context(small_disk(workspace.folder / "disk"))
    except NoDiskError as why:
        log(f"no disk is filled, for none can be made here: {why}")
        return []
    rig = stack.enter_context(closing(Rig(workspace, disk.folder / "data")))
    taken, held = list[tuple[float, float]](), 0
    for _ in range(RESTARTS):
        rig.drive()
        disk.fill()
        taken.append(rig.stop())
        rig.executive.child.kill()
        disk.empty()
        rig.restart()
        held += not rig.commands.request(MoveForward(1.0))
    name, beside = "a full disk", "kill -9 and a start with room again"
    return [
        *_figures(name, taken, "", log),
        Figure(f"{name}: latched after it", held, "starts", beside, Goal(RESTARTS, at_least=True)),
    ]


def _against(name: str, rig: Rig, samples: int, log: Log) -> list[Figure]:
    """Stop while somebody else publishes velocities on an input of the mux."""
    load, taken = rig.load(name), list[float]()
    for _ in range(samples):
        OTHERS[name](rig)
        taken.append(rig.stop_for_good())
        rig.position.check()
    rates = load.child.log.read_text(encoding="utf-8").split(stop_load.RATE)[1:]
    beside = f"{samples} stops, others at {mean(float(each.split()[0]) for each in rates):.0f} Hz"
    within = sum(each <= STATIONARY_S for each in taken)
    median_ms, max_ms = 1000 * quantile(taken, 0.5), 1000 * max(taken)
    what = f"others on {name}"
    log(
        f"{what:<36} n {samples:4}  stands within {STATIONARY_S:g} s {within:4}"
        f"  after: median {median_ms:4.0f}  max {max_ms:4.0f} ms; {beside}"
    )
    goal = Goal(samples, at_least=True)
    return [
        Figure(f"{what}: stands within {STATIONARY_S:g} s", within, "stops", beside, goal),
        Figure(f"{what}: stands after, median", median_ms, "ms", beside),
        Figure(f"{what}: stands after, max", max_ms, "ms", beside),
    ]


def _figures(
    name: str, taken: Sequence[tuple[float, float]], beside: str, log: Log
) -> list[Figure]:
    zeros_ms, stationary_ms = ([1000 * each for each in row] for row in zip(*taken, strict=True))
    acted = sum(map(math.isfinite, zeros_ms))
    median_ms, p99_ms, max_ms = quantile(zeros_ms, 0.5), quantile(zeros_ms, 0.99), max(zeros_ms)
    log(
        f"{name:<36} n {len(taken):4}  acted {acted:4}  aboard after: median {median_ms:6.1f}"
        f"  p99 {p99_ms:6.1f}  max {max_ms:6.1f} ms  stands: median"
        f" {quantile(stationary_ms, 0.5):4.0f}  max {max(stationary_ms):4.0f} ms{beside}"
    )
    beside = f"{len(taken)} stops while driving{beside}"
    return [
        Figure(f"{name}: acted", acted, "stops", beside, Goal(len(taken), at_least=True)),
        Figure(f"{name}: aboard after, median", median_ms, "ms", beside),
        Figure(f"{name}: aboard after, p99", p99_ms, "ms", beside, Goal(P99_MS)),
        Figure(f"{name}: aboard after, max", max_ms, "ms", beside, Goal(MAX_MS)),
        Figure(f"{name}: stands after, median", quantile(stationary_ms, 0.5), "ms", beside),
        Figure(f"{name}: stands after, max", max(stationary_ms), "ms", beside),
    ]
