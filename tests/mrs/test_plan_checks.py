"""Checks of plans by the rover: over real octets, in a process that ends whatever happens."""

import asyncio
import os
import pickle
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from subprocess import PIPE

import pytest

from adapters.mal import MalError, StandardError
from adapters.mrs import plan_checks
from adapters.mrs.aboard import plan_check_service
from adapters.mrs.ground import MrsClient
from adapters.mrs.plan_checks import START, CheckRequest, check_from, checked
from adapters.mrs.spec import (
    CHECK_LIMIT_S,
    AreaError,
    PlanCheck,
    PlanCheckLevel,
    PlanVerdict,
    TrialBranch,
)
from executive.commands import PlanDefinition
from executive.settings import load_settings
from tests.mrs.aboard import Aboard, raises, rover
from tests.support.plans import AHEAD, plan

CHECK, PROVE, TRY = PlanCheckLevel
GOOD = plan(f"<Sequence>{AHEAD}{AHEAD}</Sequence>")
WIDE = plan(
    '<Timeout msec="999999"><Parallel>'
    + f"<Sequence>{AHEAD * 6}</Sequence>" * 6
    + "</Parallel></Timeout>"
)
"""A plan with more states than are explored."""
SLEEPS = "import signal; signal.pause()"
"""A process that neither answers nor ends with its parent."""
TRIAL = {
    "draws": 30,
    "completed": 27,
    "share": {"low": 0.74, "high": 0.97, "confidence": 0.95},
    "figures": [
        {"name": "duration", "unit": "s", "low": 9.0, "median": 10.0, "high": 12.0, "draws": 30}
    ],
    "branches": [
        {
            "node": "Fallback",
            "line": 4,
            "kind": "Fallback",
            "choice": "home",
            "count": 5,
            "draws": 3,
        }
    ],
    "worst": {
        "draw": 7,
        "completed": False,
        "reason": "PATH_BLOCKED",
        "command": "",
        "folder": "",
        "clearance_m": 0.5,
    },
}


def children() -> set[int]:
    """Return the processes that this one started and that have not ended."""
    found = set()
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, parent = status.read_text().rpartition(") ")[2].split()[:2]
        except OSError:
            continue
        if int(parent) == os.getpid() and state != "Z":
            found.add(int(status.parent.name))
    return found


async def until(holds: Callable[[], bool]) -> None:
    """Wait until something holds, without a limit but that of the test."""
    while not holds():
        await asyncio.sleep(0.01)


def request_of(definition: PlanDefinition, level: PlanCheckLevel = PROVE) -> CheckRequest:
    return CheckRequest(level, definition, load_settings("jackal"), draws=3)


def process_of(definition: PlanDefinition, limits: str = "") -> "subprocess.Popen[bytes]":
    """Start the process aboard with a request, and other limits."""
    program = START.replace(
        "; answer_parent",
        f"; import {plan_checks.__name__} as p; {limits}\
answer_parent",
    )
    process = subprocess.Popen(
        [sys.executable, "-c", program], stdin=PIPE, stdout=PIPE, process_group=0
    )
    assert process.stdin is not None
    process.stdin.write(pickle.dumps(request_of(definition)))
    process.stdin.flush()
    return process


def answer_of(process: "subprocess.Popen[bytes]") -> PlanCheck:
    """Return the answer of the process aboard, or raise its error."""
    with process:
        assert process.stdout is not None
        return check_from(process.stdout.read(), process.wait())


async def test_a_rover_proves_a_plan_by_its_own_settings(client: MrsClient) -> None:
    proof = await client.check_plan(GOOD, PROVE)
    assert proof == checked(request_of(GOOD))
    assert (proof.verdict, proof.leaves, proof.commands) == (PlanVerdict.PROVED, 2, 2)
    assert proof.states
    assert await client.get_plan_status() == ()
    with raises(AreaError.INVALID.value):
        await client.check_plan(GOOD, TRY, draws=1001)
    with raises(AreaError.INVALID.value):
        await client.check_plan(GOOD, PROVE, draws=10)


def test_a_plan_with_a_fault_of_the_check_is_not_proved() -> None:
    waits = '<WaitUntil utc="2027-01-01T12:00:00Z"/>'
    late = '<Window until="2027-01-01T11:00:00Z"><takePicture deadline_s="9"/></Window>'
    proof = checked(request_of(plan(f"<Sequence>{waits}\n{late}</Sequence>")))
    assert proof.verdict is PlanVerdict.FAULTS
    assert [(each.line, each.text.partition(",")[0]) for each in proof.findings] == [
        (4, "it is always missed")
    ]


def test_the_command_prints_aboard_as_here(aboard: Aboard, tmp_path: Path) -> None:
    file = tmp_path / "late.xml"
    late = '<Window until="2027-01-01T00:00:00Z"><takePicture deadline_s="9"/></Window>'
    file.write_bytes(plan(late).content)
    typed = ("plan", "check", str(file), "--at", "2027-01-01T00:00:09Z")
    here, there = rover(*typed), rover(*typed, "--aboard", "--to", aboard.uri)
    assert (there.exit_code, there.output) == (1, here.output)
    assert "line 3: error" in here.output
    file.write_bytes(plan('<moveForward distance="1000" deadline_s="9"/>').content)
    here = rover("plan", "prove", str(file))
    there = rover("plan", "prove", str(file), "--aboard", "--to", aboard.uri)
    assert (there.exit_code, there.output) == (1, here.output)
    assert "116 PLAN_BAD_ARGUMENT: line 3: distance 1000 m is above its bound" in here.stderr


async def test_checks_run_one_at_a_time_and_end_with_their_client(
    client: MrsClient, aboard: Aboard, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(plan_check_service, "START", SLEEPS)
    before = children()
    first = await MrsClient.connect(aboard.uri)
    running = asyncio.create_task(first.check_plan(GOOD, PROVE))
    await until(lambda: len(children() - before) == 1)
    with pytest.raises(MalError, match="another plan is being checked") as busy:
        await client.check_plan(GOOD, CHECK)
    assert busy.value.number == AreaError.BUSY.value
    running.cancel()
    await first.close()
    await until(lambda: not children() - before)
    monkeypatch.setitem(CHECK_LIMIT_S, CHECK, 0.1)
    texts = ["another plan"]
    while "another plan" in texts[-1]:  # its process was killed, which the link sees soon
        with pytest.raises(MalError) as exceeded:
            await client.check_plan(GOOD, CHECK)
        texts.append(str(exceeded.value))
    assert "the check exceeded 0.1 s" in texts[-1]
    assert not children() - before


async def test_a_killed_trial_leaves_no_files(
    client: MrsClient, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(
        plan_check_service, "START", f"import tempfile; tempfile.mkdtemp(); {SLEEPS}"
    )
    before = children()
    running = asyncio.create_task(client.check_plan(GOOD, TRY))
    await until(lambda: any(tmp_path.glob("rover-check-*/tmp*")))
    (child,) = children() - before
    os.killpg(child, signal.SIGKILL)
    with pytest.raises(MalError, match="ended with status -9"):
        await running
    assert not any(tmp_path.glob("rover-check-*"))


async def test_a_trial_needs_a_temporary_folder(
    client: MrsClient, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "missing"))
    for _ in range(2):  # the second is not busy
        with pytest.raises(MalError, match="need a temporary folder") as refused:
            await client.check_plan(GOOD, TRY)
        assert refused.value.number == AreaError.NOT_SUPPORTED.value


async def test_a_check_ends_with_the_link(
    client: MrsClient, aboard: Aboard, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(plan_check_service, "START", SLEEPS)
    before = children()
    running = asyncio.create_task(client.check_plan(GOOD, PROVE))
    await until(lambda: len(children() - before) == 1)
    await asyncio.to_thread(aboard.hang_up)
    assert not children() - before
    running.cancel()


def test_a_process_ends_with_an_executive_that_is_killed() -> None:
    process = process_of(WIDE, "p.checked = lambda *_: __import__('signal').pause();")
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.close()
    assert process.wait() == -signal.SIGKILL
    process.stdout.close()


@pytest.mark.skipif(sys.platform != "linux", reason="of Linux")
def test_memory_that_runs_out_ends_the_process_first() -> None:
    score = "open('/proc/self/oom_score_adj').read().strip()"
    program = f"p.checked = lambda *_: p.wire_check(p.PlanVerdict.TRIED, limits=[{score}]);"
    assert answer_of(process_of(GOOD, program)).limits == ("1000",)


def test_a_proof_is_cut_short_by_time_and_ended_by_memory() -> None:
    cut = answer_of(process_of(WIDE, "p.CUT_S = 0.0;"))
    assert cut.verdict is PlanVerdict.NO_FAULT_FOUND
    assert cut.limits[0].startswith("1 ticks: 2 states were not explored")
    eats = "p.checked = lambda *_: bytearray(p.MEMORY_OCTETS);"
    with pytest.raises(MalError, match="exceeded 512 MiB of memory: check the plan on the ground"):
        answer_of(process_of(GOOD, eats))


@pytest.mark.parametrize(
    ("status", "number", "text"),
    [
        (-signal.SIGXCPU, AreaError.BUSY.value, "exceeded 10 s of processor time"),
        (-signal.SIGKILL, StandardError.INTERNAL.value, "ended with status -9"),
    ],
)
def test_the_end_of_a_process_has_an_error(status: int, number: int, text: str) -> None:
    with pytest.raises(MalError, match=text) as ended:
        check_from(b"", status)
    assert ended.value.number == number


def test_a_trial_needs_the_simulation_and_has_its_summary(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    double = f"""import json, sys
from executive.settings import load_settings
request = json.load(sys.stdin)
assert request["draws"] == 3
assert load_settings(request["asset"]) == load_settings("jackal")
print(json.dumps({TRIAL}))"""
    (tmp_path / "double.py").write_text(double)
    paths = os.pathsep.join((str(tmp_path), *filter(None, sys.path)))
    monkeypatch.setenv("PYTHONPATH", paths)
    monkeypatch.setattr(plan_checks, "TRIAL", "double")
    found = checked(request_of(GOOD, TRY))
    assert (found.verdict, found.leaves) == (PlanVerdict.TRIED, 2)
    assert found.trial is not None
    assert (found.trial.draws, found.trial.successes, found.trial.successLow) == (30, 27, 0.74)
    assert found.trial.branches == (TrialBranch(node="Fallback", line=4, choice="home", draws=3),)
    assert found.trial.worst == "draw 7: PATH_BLOCKED, 0.50 m"
    monkeypatch.setattr(plan_checks, "TRIAL", "missing_module")
    with pytest.raises(MalError, match=r"the simulation failed: .*missing_module"):
        checked(request_of(GOOD, TRY))
    monkeypatch.setattr(plan_checks, "find_spec", lambda _: None)
    with pytest.raises(MalError, match=r"pip install 'rover-executive\[sim,campaign\]'") as refused:
        checked(request_of(GOOD, TRY))
    assert refused.value.number == AreaError.NOT_SUPPORTED.value


def test_a_trial_aboard_is_printed_as_one_here(
    aboard: Aboard, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    double = f"p._run_trial = lambda *_: {TRIAL}; answer_parent"
    program = f"; import {plan_checks.__name__} as p; {double}"
    monkeypatch.setattr(plan_check_service, "START", START.replace("; answer_parent", program))
    file = tmp_path / "ahead.xml"
    file.write_bytes(GOOD.content)
    typed = ("plan", "try", str(file), "--aboard", "--to", aboard.uri)
    tried = rover(*typed)
    assert (tried.exit_code, tried.output.splitlines()) == (
        1,
        [
            "ahead: 27 of 30 draws completed; share 0.740 .. 0.970 with confidence 0.95",
            "  duration  10 s (5 .. 95 %: 9 .. 12)",
            "  line 4: Fallback: home in 3 draws",
            "  worst: draw 7: PATH_BLOCKED, 0.50 m",
        ],
    )
    usage = rover(*typed, "--seed", "3", "--set", "world=yard")
    assert usage.exit_code == 2
    assert "--seed, --set: not with --aboard" in usage.output
