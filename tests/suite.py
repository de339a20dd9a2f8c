"""The command `rover test`: every check that a change must pass."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
import uuid
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from itertools import repeat
from pathlib import Path
from tempfile import TemporaryFile
from types import FrameType
from typing import BinaryIO, Final, NoReturn

import click

CHECKOUT: Final = Path(__file__).resolve().parents[1]
CORE_TESTS: Final = ("tests/core", "tests/trees")
SAFETY_TESTS: Final = ("tests/safety",)
"""Tests in simulated time: they may wait for as long as others need the processors."""
SECURITY_TESTS: Final = ("tests/security",)
"""Attacks over sockets and on processes; they cover the core, too."""
MEASURED: Final = (*CORE_TESTS, *SAFETY_TESTS, *SECURITY_TESTS)
SIMULATED_TESTS: Final = (
    "tests/brick/test_any_commands.py",
    "tests/brick/test_manners.py",
    "tests/brick/test_rover.py",
    "tests/bundle/test_codec.py",
    "tests/bundle/test_ltp.py",
    "tests/bundle/test_node.py",
    "tests/calibration",
    "tests/campaign/test_after_faults.py",
    "tests/campaign/test_failed.py",
    "tests/conformance",
    "tests/docs/test_campaigns.py",
    "tests/docs/test_commands.py",
    "tests/docs/test_missions.py",
    "tests/drawing",
    "tests/mops",
    "tests/navigation",
    "tests/plot",
    "tests/recording/test_completion.py",
    "tests/recording/test_damaged.py",
    "tests/recording/test_replay.py",
    "tests/robots/test_figures.py",
    "tests/scenarios",
    "tests/sim",
    "tests/simulated",
    "tests/stress/test_bundle_fuzz.py",
    "tests/stress/test_core_storm.py",
    "tests/stress/test_ledger_kills.py",
    "tests/stress/test_mops_fuzz.py",
    "tests/stress/test_plan_kills.py",
    "tests/stress/test_recording_fuzz.py",
    "tests/trial",
)
"""Other tests that need no real time."""
SLOWEST: Final = ("--durations=10", "--durations-min=5")
WHEN_IDLE: Final = ("chrt", "--idle", "0")
"""Run a command only while a processor has nothing else to do; any other process interrupts it."""


@dataclass(frozen=True, slots=True)
class CiCheck:
    """Programs to run in the checkout one after the other; passed where all exit 0."""

    name: str
    commands: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, slots=True)
class CiCheckResult:
    """How a check ended, and how long it took."""

    name: str
    passed: bool
    took_s: float


def _python(*arguments: str) -> tuple[str, ...]:
    return (sys.executable, "-m", *arguments)


def _pytest(marked: str, *arguments: str, workers: int = 2) -> tuple[str, ...]:
    """Return the arguments of a run of the tests with a mark, some files at once, slow ones first.

    The order is that of `tests/conftest.py`; xdist begins with the files that have most tests.
    """
    in_order = ("--dist", "loadfile", "--no-loadscope-reorder")
    return ("pytest", "-m", marked, "-n", str(workers), *in_order, *SLOWEST, *arguments)


def ros_files(tests: Path = CHECKOUT / "tests", busy: bool | None = None) -> tuple[str, ...]:
    """Return the files that say `mark.ros`; to import all others takes half a minute.

    Args:
        tests: where they are looked for; there need not be any.
        busy: True for the files with `mark.busy`, False for those without it, None for all.
    """
    texts = {path: path.read_text() for path in tests.rglob("test_*.py")}
    found = (
        path
        for path, text in texts.items()
        if "mark.ros" in text and busy in (None, "mark.busy" in text)
    )
    return tuple(sorted(str(path.relative_to(tests.parent)) for path in found))


def wholly_ros_files(tests: Path = CHECKOUT / "tests") -> tuple[str, ...]:
    """Return those of them that mark all of their tests: other parts need not import rclpy."""
    marked = re.compile(r"^pytestmark = (\[[^]]*)?pytest\.mark\.ros\b", re.MULTILINE)
    found = (path for path in ros_files(tests) if marked.search((tests.parent / path).read_text()))
    return tuple(found)


def _covered(*arguments: str) -> tuple[str, ...]:
    """Return the arguments of a run of tests under coverage, which doubles the time of Python.

    It is one process: imports of measured modules take twice as long, too.
    """
    return _python("coverage", "run", "-m", "pytest", "-m", "not ros", *arguments)


SECURITY: Final = CiCheck(
    "pytest, security", (_python("coverage", "erase"), _covered(*SECURITY_TESTS))
)
PATIENT: Final = ("-o", "faulthandler_timeout=3600")
"""Nothing hangs that waits for a processor."""
CORE, SAFETY = (
    CiCheck(f"pytest, {name}", ((*WHEN_IDLE, *_covered(*PATIENT, *tests)),))
    for name, tests in (("core", CORE_TESTS), ("safety", SAFETY_TESTS))
)
"""Two processes, so that the last of them is not long alone."""
SIMULATED: Final = CiCheck(
    "pytest, simulated",
    ((*WHEN_IDLE, *_python("pytest", "-m", "not ros", *SLOWEST, *PATIENT, *SIMULATED_TESTS)),),
)
STATIC_CHECKS: Final = (
    CiCheck("ruff check", (_python("ruff", "check", "."),)),
    CiCheck("ruff format", (_python("ruff", "format", "--check", "."),)),
    CiCheck("import contracts", ((str(Path(sys.executable).with_name("lint-imports")),),)),
)
MYPY: Final = CiCheck("mypy", (_python("mypy"),))
COVERAGE: Final = CiCheck(
    "coverage of the core",
    (_python("coverage", "combine", "--quiet"), _python("coverage", "report")),
)
STRESS: Final = {
    "storm": {"--commands": (100_000, 1000)},
    "power-cuts": {"--kills": (2000, 50)},
    "authority": {"--interleavings": (100_000, 1000)},
    "replays": {"--runs": (500, 3)},
    "forks": {"--forks": (200, 2)},
    "regressions": {"--recordings": (100, 7)},
    "navigation": {"--drives": (50, 1)},
    "saving": {"--runs": (50, 3)},
    "fuzz": {"--messages": (1_000_000, 5000)},
    "bundle-fuzz": {"--messages": (300_000, 5000)},
    "mops-fuzz": {"--messages": (150_000, 1000)},
    "recording-fuzz": {"--recordings": (20_000, 60)},
    "plan-traces": {"--plans": (30_000, 500)},
    "plan-kills": {"--kills": (2_000, 60)},
    "plan-days": {"--days": (10, 1)},
    "predicted-poses": {"--sites": (9, 2)},
    "bundle-kills": {"--kills": (100, 3)},
    "campaign-kills": {"--kills": (20, 2)},
    "kills": {"--kills": (50, 3)},
    "relay": {"--messages": (10_000, 200), "--kills": (20, 2)},
}
"""Attacks of `rover bench`, each with how much of it there is in full, and at least."""
LONG: Final = {"plan-days": 10, "predicted-poses": 5}
"""From which percentage on those with a long least part are run; tests have half an hour of it."""
STRESS_HOURS: Final = 24.0, 0.2
"""Of operations in simulated time, in full and at least."""
MEMORY: Final = Path("/dev/shm")
LEAST_FREE_OCTETS: Final = 4 << 30
"""The folders that pytest keeps, those of three runs, take a quarter of that."""
DRAWN: Final = re.compile(r"^from (hypothesis|tests\.support\.examples) import", re.MULTILINE)
"""In files of tests with fewer examples here than in `--stress`."""
PLANTED_SEEDS: Final = 4
"""From which each planted fault is looked for; with none, only in its situations."""
MARK: Final = "ROVER_TEST"
"""Variable in the environment of all processes of a run, whatever their parent or session."""
RUN: Final = uuid.uuid4().hex
TERMINATE_TIMEOUT_S: Final = 5.0
_ended_by: Final[list[int]] = []
"""The signals that end this run: after one, no check in a queue begins."""


@click.command(context_settings={"ignore_unknown_options": True})
@click.option(
    "--stress",
    is_flag=True,
    help="Instead: random commands, wrong messages, kill -9 and bad links (some two hours).",
)
@click.option(
    "--stress-percent",
    "percent",
    type=click.IntRange(1, 100),
    default=100,
    show_default=True,
    help="How much of that.",
)
@click.option(
    "--simulated",
    "hours",
    type=click.FloatRange(min=0.0, min_open=True),
    metavar="HOURS",
    help="Instead: storms of kills and faults in simulated time, for so many hours of it.",
)
@click.option("--seed", default="1", show_default=True, help="Of those storms.")
@click.option("--trace", is_flag=True, help="Show the timeline of a storm that breaks a promise.")
@click.argument("pytest_arguments", nargs=-1, type=click.UNPROCESSED)
def test(
    stress: bool,
    percent: int,
    hours: float | None,
    seed: str,
    trace: bool,
    pytest_arguments: tuple[str, ...],
) -> None:
    """Run all checks of this checkout, or only some tests.

    Without arguments: style, types, import contracts, the whole test suite and its coverage. With
    arguments: pytest alone, with these; paths start at the top of the checkout. Ctrl-C and SIGTERM
    end all processes of the run.

    \b
    Examples:
      rover test
      rover test tests/mal
      rover test -k duplicate -x
      rover test --stress --stress-percent 10
      rover test --simulated 0.5 --seed 7
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _end_run)
    if hours is not None:
        sys.exit(_run((*_simulated(hours, seed), *(["--trace"] if trace else []))))
    if pytest_arguments:
        sys.exit(_run(_python("pytest", *pytest_arguments)))
    outcomes = list(map(_carry_out, stress_checks(percent)) if stress else _carry_out_all())
    _summarize(outcomes)
    sys.exit(any(not outcome.passed for outcome in outcomes))


def stress_checks(percent: int) -> list[CiCheck]:
    """Return the attacks of `rover bench` and storms of new seeds, with so much of each."""
    rover = str(Path(sys.executable).with_name("rover"))
    checks = []
    for name, options in STRESS.items():
        if percent < LONG.get(name, 1):
            continue
        counts = {
            option: max(least, full * percent // 100) for option, (full, least) in options.items()
        }
        arguments = (f"{option}={number}" for option, number in counts.items())
        checks.append(CiCheck(name, ((rover, "bench", name, *arguments),)))
    full, least = STRESS_HOURS
    storms = _simulated(max(least, full * percent / 100), seed=str(time.time_ns()))
    planted = _python("tests.simulated.planted", "--seeds", str(PLANTED_SEEDS * percent // 100))
    played = ("tests/robots/test_robots.py", "tests/robots/test_robot_new.py")
    at_once = ("-n", "2", "--dist", "worksteal")
    robots = ("env", "ROBOTS=all", *_python("pytest", "-q", *at_once, *played))
    not_all = () if percent == 100 else ("-k", "not commands_of_the_page")
    patient = _python("pytest", "-q", "-rsP", "-o", "faulthandler_timeout=7200")
    installed = (*patient, "tests/stress/installed_wheel.py", *not_all)
    bare = (*patient, "tests/stress/debian_roots.py")
    service = _python("pytest", "-q", "-rs", "tests/stress/service_boot.py")
    some = () if percent == 100 else ("-k", "ground")  # the image without ROS is built soonest
    images = (*patient, "tests/stress/containers.py", *some)
    tested = (CHECKOUT / "tests").rglob("test_*.py")
    drawn = (str(path) for path in tested if DRAWN.search(path.read_text()))
    few = "lock-honest or relay-another or lock-executive-killed or lock-navigation-paused"
    live = () if percent == 100 else ("-k", few)
    below = _python("pytest", "-q", "-rP", "tests/stress/navigation_processes.py", *live)
    proofs = _python("pytest", "-q", "-rP", "tests/stress/plan_checks_aboard.py")
    times = ("env", f"NAVIGATED_DRIVES={max(1, 3 * percent // 100)}")
    clients = ("env", f"ROS_CLIENTS={percent}", *_python("pytest", "-q", "-rP"))
    examples = ("env", "EXAMPLES=all", *_python("pytest", "-q", *at_once, *drawn))
    site = "runs/site"
    shown = ("env", f"SITE={site}", *_python("pytest", "-q", "tests/docs/test_site.py"))
    whole = () if percent == 100 else ("-k", "hill")
    missions = _python("pytest", "-q", "tests/stress/whole_missions.py", *whole)
    templates = ("env", "TEMPLATES=all", *_python("pytest", "-q", "tests/docs/test_examples.py"))
    return [
        *checks,
        CiCheck("site", ((rover, "docs", f"--out={site}"), shown)),
        CiCheck("simulated", (storms,)),
        CiCheck("planted", (planted,)),
        CiCheck("robots", (robots,)),
        CiCheck("plan-checks", (proofs,)),
        CiCheck("navigations", ((*times, *below),)),
        CiCheck("ROS clients", ((*clients, "tests/stress/ros_clients.py"),)),
        CiCheck("examples", (examples,)),
        CiCheck("templates", (templates,)),
        CiCheck("missions", (missions,)),
        CiCheck("installation", (installed,)),
        CiCheck("containers", (images,)),
        CiCheck("service", (service,)),
        *([CiCheck("Debian", (bare,))] if percent == 100 else []),
    ]


def _simulated(hours: float, seed: str) -> tuple[str, ...]:
    return _python("tests.simulated", f"{hours:g}", "--seed", seed)


def _run(command: tuple[str, ...], output: BinaryIO | None = None) -> int:
    return subprocess.run(
        command, cwd=CHECKOUT, env=environment(), check=False, stdout=output, stderr=output
    ).returncode


def _end_run(number: int, _: FrameType | None) -> NoReturn:
    """End every process of this run, then this one."""
    _ended_by.append(number)
    import psutil  # of requirements-test.lock: `rover completion` imports this module without it

    def in_run(process: psutil.Process) -> bool:
        with suppress(psutil.Error):
            if process.status() != psutil.STATUS_ZOMBIE and process.pid != os.getpid():
                return process.environ().get(MARK) == RUN
        return False

    for end in (signal.SIGINT, signal.SIGTERM):
        signal.signal(end, signal.SIG_IGN)
    # Not psutil.wait_procs: it would take the exit status that `subprocess` waits for.
    deadline_s, terminated = time.monotonic() + TERMINATE_TIMEOUT_S, set[int]()
    while found := [process for process in psutil.process_iter() if in_run(process)]:
        for process in found:
            with suppress(psutil.NoSuchProcess):
                if time.monotonic() > deadline_s:
                    process.kill()
                elif process.pid not in terminated:
                    process.terminate()
            terminated.add(process.pid)
        time.sleep(0.1)
    sys.exit(128 + number)


def environment() -> dict[str, str]:
    """Return the environment of a check: hundreds of processes share the byte code of one.

    Where there is room, folders of tests lie in memory: each commit of a ledger waits for a disk.
    """
    unwanted = "PYTHONDONTWRITEBYTECODE"
    found = {name: value for name, value in os.environ.items() if name != unwanted} | {MARK: RUN}
    roomy = MEMORY.is_dir() and shutil.disk_usage(MEMORY).free >= LEAST_FREE_OCTETS
    if roomy and not os.statvfs(MEMORY).f_flag & os.ST_NOEXEC:  # some tests write programs
        found.setdefault("PYTEST_DEBUG_TEMPROOT", str(MEMORY))
    return found


def _carry_out_all() -> Iterator[CiCheckResult]:
    """Yield outcomes; both long parts leave some time of the processors to other checks."""
    yield from map(_carry_out, STATIC_CHECKS)
    of_others = (*MEASURED, *SIMULATED_TESTS, *wholly_ros_files())
    ignored = (f"--ignore={path}" for path in of_others)
    # Many of these wait for others: clusters, orbiters, ION, a browser.
    rest = CiCheck("pytest", (_python(*_pytest("not ros", *ignored, workers=3)),))
    yield from _carry_out_beside(rest, MYPY, SECURITY)
    # In real time: two busy files at once, and two that wait for motions and discovery. Nothing
    # runs beside them that they would have to wait for.
    ros, waiting = (
        CiCheck(name, (_python(*_pytest("ros"), *ros_files(busy=busy)),))
        for name, busy in (("pytest, ros", True), ("pytest, waiting", False))
    )
    yield from _carry_out_beside(ros, waiting, CORE, SIMULATED, SAFETY, at_once=3)
    yield _carry_out(COVERAGE)


def _carry_out_beside(
    check: CiCheck, *others: CiCheck, at_once: int = 1
) -> Iterator[CiCheckResult]:
    """Yield the outcome of a check, then those of others, which run beside it in their order.

    Args:
        at_once: how many of the others.
    """
    with ExitStack() as files, ThreadPoolExecutor(at_once) as pool:
        outputs = [files.enter_context(TemporaryFile()) for _ in others]
        beside = list(map(pool.submit, repeat(_judge), others, outputs))
        yield _carry_out(check)
        for other, output, outcome in zip(others, outputs, beside, strict=True):
            result = outcome.result()
            click.secho(_headline(other.name), bold=True)
            output.seek(0)
            click.echo(output.read(), nl=False)
            yield result


def _carry_out(check: CiCheck) -> CiCheckResult:
    click.secho(_headline(check.name), bold=True)
    return _judge(check)


def _judge(check: CiCheck, output: BinaryIO | None = None) -> CiCheckResult:
    """Run a check; its output goes to a file, or where that of this process goes."""
    if _ended_by:
        return CiCheckResult(check.name, False, 0.0)
    began_s = time.monotonic()
    passed = all(_run(command, output) == 0 for command in check.commands)
    return CiCheckResult(check.name, passed, time.monotonic() - began_s)


def _headline(name: str) -> str:
    return f"── {name} ".ljust(72, "─")


def _summarize(outcomes: list[CiCheckResult]) -> None:
    click.secho("── summary ".ljust(72, "─"), bold=True)
    for outcome in outcomes:
        word, colour = ("passed", "green") if outcome.passed else ("FAILED", "red")
        click.echo(f"{outcome.name:<18}{click.style(word, fg=colour)}{outcome.took_s:>9.1f} s")
