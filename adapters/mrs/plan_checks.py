"""Checks of a plan before its uplink: on the ground, and aboard in a process of their own.

The process aboard gets a `CheckRequest` from the executive, and answers in MAL octets. It ends
with the executive, which holds the other end of its standard input. If memory runs out, the system
ends it before the executive.
"""

import json
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from base64 import b64encode
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any, Final

import yaml

from adapters.mal import Codec, Field, InteractionStage, MalError, StandardError
from adapters.mrs.spec import (
    AreaError,
    PlanCheck,
    PlanCheckLevel,
    PlanFinding,
    PlanVerdict,
    mrs_specification,
    refused_check,
    trial_of,
    wire_check,
    with_text,
)
from executive.commands import PlanDefinition
from executive.plans import Finding, Level, check_plan, find_faults, max_commands, steps
from executive.settings import Settings, unstructure
from executive.values.reasons import Refusal

LOWEST_PRIORITY: Final = 19
CPU_S: Final = 10
"""Processor time of a check or proof aboard, s; the limits here are chosen."""
CUT_S: Final = 8.0
"""Processor time after which a proof aboard is cut short, which its limits report, s."""
MEMORY_OCTETS: Final = 512 << 20
"""Address space of a check or proof aboard; without a plan it takes 60 MiB."""
TRIAL: Final = "sim.trial"
"""Module that runs a plan in simulation: JSON from its standard input to its standard output."""
START: Final = (
    f"import os; os.setpriority(os.PRIO_PROCESS, 0, {LOWEST_PRIORITY});"
    f" from {__name__} import answer_parent; answer_parent()"
)
"""Program of the process: it lowers its priority before the imports, which take long."""


@dataclass(frozen=True, slots=True)
class CheckRequest:
    """A plan to be checked.

    Attributes:
        settings: settings of the asset that is to execute it.
        draws: number of runs of `TRY`.
        begin_utc_s: planned begin for `CHECK`, s UTC; None if unknown.
    """

    level: PlanCheckLevel
    definition: PlanDefinition
    settings: Settings
    draws: int = 0
    begin_utc_s: float | None = None


def checked(request: CheckRequest, is_over: Callable[[], bool] = lambda: False) -> PlanCheck:
    """Return the result of a check.

    Args:
        request: the plan.
        is_over: a proof is cut short once it returns True.

    Raises:
        MalError: NotSupported, the simulation is not installed, or failed.
    """
    definition = request.definition
    plan = check_plan(definition, request.settings)
    if isinstance(plan, Refusal):
        return refused_check(plan)
    counts: dict[str, Any] = {"leaves": len(steps(plan)), "commands": max_commands(plan)}
    match request.level:
        case PlanCheckLevel.CHECK:
            found = find_faults(plan, request.begin_utc_s)
            return wire_check(PlanVerdict.NO_FAULT_FOUND, found, **counts)
        case PlanCheckLevel.PROVE:
            from trees.plan import prove  # imports py_trees, which takes long

            proof = prove(plan, is_over=is_over)
            verdict = PlanVerdict.NO_FAULT_FOUND if proof.limits else PlanVerdict.PROVED
            counts |= {"states": proof.states, "ticks": proof.ticks}
            # A timer may end at any time in a proof: a window that is always missed is not seen.
            static = (each for each in find_faults(plan) if each.level is not Level.NOTE)
            found = tuple(sorted({*static, *proof.findings}, key=lambda each: each.line))
            return wire_check(verdict, found, proof.limits, **counts)
        case PlanCheckLevel.TRY:
            with NamedTemporaryFile("w", suffix=".yaml", encoding="utf-8") as file:
                yaml.safe_dump(unstructure(request.settings), file)
                file.flush()
                trial = trial_of(_run_trial(request, file.name))
            return wire_check(PlanVerdict.TRIED, trial=trial, **counts)


def _run_trial(request: CheckRequest, asset: str) -> Any:
    """Return the JSON of simulated runs, by a settings file.

    Raises:
        MalError: NotSupported, the simulation is not installed, or failed.
    """
    if any(find_spec(name) is None for name in ("sim", "mujoco", "scipy")):
        text = "the simulation is not installed aboard: pip install 'rover-executive[sim,campaign]'"
        raise with_text(AreaError.NOT_SUPPORTED, text)
    definition = request.definition
    wanted = {
        "plan_id": definition.plan_id,
        "name": definition.name,
        "format": definition.format,
        "content_base64": b64encode(definition.content).decode(),
        "arguments": [{"name": each.name, "value": each.text} for each in definition.arguments],
        "asset": asset,
        "draws": request.draws,
        "begin_utc_s": request.begin_utc_s,
    }
    command = [sys.executable, "-P", "-m", TRIAL]
    ended = subprocess.run(command, input=json.dumps(wanted).encode(), capture_output=True)
    if ended.returncode not in {0, 1} or not ended.stdout:
        lines = ended.stderr.decode(errors="replace").strip().splitlines()
        text = f"the simulation failed: {lines[-1] if lines else ended.returncode}"
        raise with_text(AreaError.NOT_SUPPORTED, text)
    return json.loads(ended.stdout)


def received_finding(finding: PlanFinding) -> Finding:
    """Return a finding of a rover."""
    return Finding(Level[finding.level.name], finding.line, finding.node, finding.text)


@cache
def _codec() -> tuple[Codec, tuple[Field, ...]]:
    operation = mrs_specification().operation("Plan", "checkPlan")
    return Codec(mrs_specification()), operation.parts[InteractionStage.REQUEST_RESPONSE]


def check_from(octets: bytes, status: int) -> PlanCheck:
    """Return the answer of the process, given its output and its exit status.

    Raises:
        MalError: its answer is an error, or it was ended.
    """
    codec, parts = _codec()
    match status:
        case 0:
            (check,) = codec.decode(parts, octets)
            assert isinstance(check, PlanCheck)
            return check
        case 1 if octets:
            raise codec.decode_error(octets)
        case _ if status == -signal.SIGXCPU:
            raise _exceeded(f"{CPU_S} s of processor time")
        case _:
            text = f"the process of the check ended with status {status}; the log aboard has more"
            raise with_text(StandardError.INTERNAL, text)


def _exceeded(limit: str) -> MalError:
    return with_text(AreaError.BUSY, f"the check exceeded {limit}: check the plan on the ground")


def answer_parent() -> None:
    """Answer the request on standard input; the body of the process aboard."""
    request = pickle.load(sys.stdin.buffer)  # of the executive, which started this process
    assert isinstance(request, CheckRequest)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(OSError):  # not on Linux; a simulation's memory has no limit of its own
        Path("/proc/self/oom_score_adj").write_text("1000")
    if request.level is not PlanCheckLevel.TRY:
        _limit()
    codec, parts = _codec()
    try:
        octets, status = codec.encode(parts, (checked(request, _is_over),)), 0
    except MemoryError:
        error, status = _exceeded(f"{MEMORY_OCTETS >> 20} MiB of memory"), 1
        octets = codec.encode_error(error)
    except MalError as error:
        octets, status = codec.encode_error(error), 1
    sys.stdout.buffer.write(octets)
    sys.stdout.buffer.flush()
    os._exit(status)  # without waiting for the thread


def _is_over() -> bool:
    return time.process_time() > CUT_S


def _limit() -> None:
    import resource  # not in Python for Windows, where this module is imported, too

    resource.setrlimit(resource.RLIMIT_CPU, (CPU_S, CPU_S + 1))
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_OCTETS, MEMORY_OCTETS))


def _end_with_parent() -> None:
    """End this process, and those that it started, when the executive has ended."""
    while os.read(sys.stdin.fileno(), 1):
        pass
    os.killpg(os.getpid(), signal.SIGKILL)
