"""What `rover test` runs: attacks, in proportion, and the files of tests on ROS."""

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from executive.settings import names_in
from tests import suite
from tests.benchmarks.commands import bench
from tests.support import patience


def test_every_attack_is_a_benchmark_and_runs_in_full_as_that_does() -> None:
    for name, options in suite.STRESS.items():
        params = {opt: param for param in bench.commands[name].params for opt in param.opts}
        assert {opt: params[opt].default for opt in options} == {
            opt: full for opt, (full, _) in options.items()
        }


def test_a_share_of_the_stress_is_never_none_of_it() -> None:
    (kills,) = [check for check in suite.stress_checks(1) if check.name == "kills"]
    assert kills.commands[0][1:] == ("bench", "kills", "--kills=3")
    assert suite.stress_checks(100)[0].commands[0][1:] == ("bench", "storm", "--commands=100000")
    for percent, hours in ((1, "0.24"), (100, "24")):
        found = {check.name: check.commands[0] for check in suite.stress_checks(percent)}
        assert found["simulated"][1:4] == ("-m", "tests.simulated", hours)
        assert found["planted"][-1] == str(4 * percent // 100)


def test_files_of_tests_on_ros_are_found_by_their_mark(tmp_path: Path) -> None:
    folder = tmp_path / "tests" / "some"
    folder.mkdir(parents=True)
    for name, text in (
        ("a", "def test_nothing() -> None: ..."),
        ("b", "pytestmark = [\n    pytest.mark.slow,\n    pytest.mark.ros,\n]"),
        ("c", "pytestmark = [pytest.mark.slow]\n\n@pytest.mark.ros\ndef test_c() -> None: ..."),
        ("d", "pytestmark = pytest.mark.ros"),
        ("e", "WRITTEN = 'pytestmark = pytest.mark.ros'"),
        ("f", "pytestmark = [pytest.mark.busy, pytest.mark.ros]"),
    ):
        (folder / f"test_{name}.py").write_text(f"import pytest\n\n{text}\n")
    tests = tmp_path / "tests"
    assert suite.ros_files(tests) == tuple(f"tests/some/test_{name}.py" for name in "bcdef")
    assert suite.ros_files(tests, busy=False) == suite.ros_files(tests)[:-1]
    assert suite.ros_files(tests, busy=True) == ("tests/some/test_f.py",)
    assert suite.wholly_ros_files(tests) == tuple(f"tests/some/test_{name}.py" for name in "bdf")
    assert suite.ros_files(tmp_path / "nowhere") == ()


def test_the_suite_leaves_out_what_a_user_keeps_in_the_configuration(tmp_path: Path) -> None:
    config = tmp_path / "checkout" / "config"
    shutil.copytree(patience.shipped_config(tmp_path), config)
    shipped = patience.shipped_names(config)
    for command in (("init", "-q"), ("add", ".")):
        subprocess.run(("git", *command), cwd=config, check=True)
    for name in ("scout.yaml", "scout.ros.yaml", "scenarios/mine.yaml"):
        (config / name).write_text("asset: scout\n")
    assert "scout" in names_in(config)
    assert patience.shipped_names(config) == shipped
    assert "mine" not in patience.shipped_names(config / "scenarios")
    copy = patience.patient_config(tmp_path / "copy", config)
    assert names_in(copy) == shipped
    assert not list(copy.rglob("scout*"))


def test_byte_code_is_retained_while_checks_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    monkeypatch.setenv("ROVER_CI", "1")
    assert "PYTHONDONTWRITEBYTECODE" not in suite.environment()
    assert suite.environment()["ROVER_CI"] == "1"


def test_folders_of_tests_lie_in_memory_where_it_is_large(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    name = "PYTEST_DEBUG_TEMPROOT"
    monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(suite, "MEMORY", tmp_path)
    monkeypatch.setattr(suite, "LEAST_FREE_OCTETS", 0)
    assert suite.environment()[name] == str(tmp_path)
    monkeypatch.setattr(suite, "LEAST_FREE_OCTETS", 1 << 60)
    assert name not in suite.environment()
    monkeypatch.setattr(suite, "MEMORY", tmp_path / "none")
    assert name not in suite.environment()


def test_checks_beside_another_report_after_it(capfd: pytest.CaptureFixture[str]) -> None:
    def check(name: str, code: str) -> suite.CiCheck:
        return suite.CiCheck(name, ((sys.executable, "-c", code),))

    first, second = check("first", "print('of the first')"), check("second", "exit(1)")
    outcomes = list(suite._carry_out_beside(check("long", "print('long')"), first, second))
    found = [(each.name, each.passed) for each in outcomes]
    assert found == [("long", True), ("first", True), ("second", False)]
    written = capfd.readouterr().out
    assert written.index("long") < written.index("of the first")


MEET = """
import sys, time
from pathlib import Path
own, other = map(Path, sys.argv[1:])
own.touch()
deadline_s = time.monotonic() + 60
while not other.exists():
    assert time.monotonic() < deadline_s
    time.sleep(0.01)
"""


def test_checks_beside_another_run_at_once(tmp_path: Path) -> None:
    def check(*names: str) -> suite.CiCheck:
        paths = (str(tmp_path / name) for name in names)
        return suite.CiCheck("meets", ((sys.executable, "-c", MEET, *paths),))

    checks = (check("a", "b"), check("b", "c"), check("c", "a"))
    assert all(each.passed for each in suite._carry_out_beside(*checks, at_once=2))


DETACHED = """
import os, subprocess, sys, time
for command in ("import time; time.sleep(600)", "import signal; signal.pause()"):
    subprocess.Popen([sys.executable, "-c", command], start_new_session=True)
print(os.getpid(), flush=True)
time.sleep(600)
"""
RUN_CHECK = """
import sys
from tests import suite
from tests.suite import CiCheck, test
check = CiCheck("dummy", ((sys.executable, "-c", sys.argv.pop()),))
queued = CiCheck("queued", ((sys.executable, "-c", f"open({sys.argv.pop()!r}, 'w')"),))
suite._carry_out_all = lambda: suite._carry_out_beside(check, check, queued)
test(standalone_mode=False)
"""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_all_processes_of_a_run_in_any_session(
    number: signal.Signals, tmp_path: Path
) -> None:
    began = tmp_path / "began"
    with subprocess.Popen(
        [sys.executable, "-c", RUN_CHECK, str(began), DETACHED],
        stdout=subprocess.PIPE,
        text=True,
        cwd=suite.CHECKOUT,
        env={**os.environ, "PYTHONPATH": str(suite.CHECKOUT)},
    ) as run:
        assert run.stdout is not None
        while not (line := run.stdout.readline()).strip().isdecimal():
            assert line, "the check has started"
        started = [psutil.Process(int(line)), *psutil.Process(int(line)).children()]
        assert len(started) == 3
        run.send_signal(number)
        rest = run.stdout.read()
    assert run.returncode == 128 + number
    assert "summary" not in rest
    assert [each for each in started if each.is_running() and each.status() != "zombie"] == []
    assert not began.exists(), "a check in the queue has begun"
