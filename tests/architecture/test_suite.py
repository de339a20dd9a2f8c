"""What `rover test` runs: attacks, in proportion, and the files of tests on ROS."""

from pathlib import Path

import pytest

from tests import suite
from tests.benchmarks.commands import bench


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
    marked, plain = tmp_path / "tests" / "room" / "test_b.py", tmp_path / "tests" / "test_a.py"
    marked.parent.mkdir(parents=True)
    marked.write_text("import pytest\n\npytestmark = [pytest.mark.ros, pytest.mark.slow]\n")
    plain.write_text("def test_nothing() -> None: ...\n")
    assert suite.ros_files(tmp_path / "tests") == ("tests/room/test_b.py",)
    assert suite.ros_files(tmp_path / "nowhere") == ()


def test_byte_code_is_kept_while_checks_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    monkeypatch.setenv("ROVER_CI", "1")
    assert "PYTHONDONTWRITEBYTECODE" not in suite.environment()
    assert suite.environment()["ROVER_CI"] == "1"
