"""`rover demo --mocup`: MAL, executive, ROS, rover-nxt, the cable and the brick, as processes."""

from pathlib import Path

import pytest

from tests.demo.test_demo import Demo

pytestmark = [pytest.mark.ros, pytest.mark.slow]


def test_the_small_rover_does_as_planned(tmp_path: Path) -> None:
    played = Demo("--mocup", "--out", str(tmp_path / "run"))
    status, output = played.end()
    assert status == 0, output
    assert [" ".join(process.cmdline()) for process in played.others()] == []
    assert (tmp_path / "run" / "map.png").stat().st_size > 0
    assert (tmp_path / "run" / "nxt.log").is_file()
