"""What makes the storm: the link loses, doubles and goes dark, clocks are set, disks are full."""

import errno
import os
import sys
from pathlib import Path
from random import Random
from subprocess import PIPE, Popen

import pytest

from tests.stress.fake_clock import set_clock
from tests.stress.lossy_link import Weather
from tests.stress.small_disk import DISK_OCTETS, NoDiskError, small_disk

TELLS = """\
import sys, time
for _ in sys.stdin:
    print(time.time(), flush=True)
"""


def test_the_link_does_what_it_is_asked_for() -> None:
    weather = Weather(Random(1), loss=0.3, scale=20.0)
    delays_s = [weather.delays_s(number / 100) for number in range(60_000)]
    done = weather.done
    lit = len(delays_s) - done["dark"]
    assert 0.27 < done["lost"] / (lit + done["doubled"]) < 0.33
    assert 0.02 < done["doubled"] / lit < 0.04
    assert 0.2 < done["dark"] / len(delays_s) < 0.5
    assert 80 < done["nights"] < 200
    assert 0.0 < max(each for delays in delays_s for each in delays) < 1 / 20
    assert delays_s == [
        again.delays_s(number / 100)
        for again in (Weather(Random(1), loss=0.3, scale=20.0),)
        for number in range(60_000)
    ]


def test_a_clock_is_set_while_its_process_runs(tmp_path: Path) -> None:
    (tmp_path / "tells.py").write_text(TELLS)
    clock = tmp_path / "clock"
    set_clock(clock, 0.0)
    command = [sys.executable, "-m", "tests.stress.fake_clock", str(clock), "tells"]
    checkout = str(Path(__file__).parents[2])
    told_s = []
    with Popen(
        command,
        stdin=PIPE,
        stdout=PIPE,
        text=True,
        env={"PYTHONPATH": f"{checkout}:{tmp_path}"},
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        for wrong_by_s in (0.0, -3600.0):
            set_clock(clock, wrong_by_s)
            process.stdin.write("\n")
            process.stdin.flush()
            told_s.append(float(process.stdout.readline()))
        process.stdin.close()
    assert -3601.0 < told_s[1] - told_s[0] < -3500.0


def test_a_disk_is_full_from_one_moment_to_the_next_and_has_room_again(tmp_path: Path) -> None:
    try:
        with small_disk(tmp_path / "disk") as disk:
            path = disk.folder / "file"
            path.write_bytes(bytes(1 << 20))
            disk.fill()
            with pytest.raises(OSError, match=os.strerror(errno.ENOSPC)):
                path.write_bytes(bytes(2 << 20))
            disk.empty()
            path.write_bytes(bytes(DISK_OCTETS // 2))
    except NoDiskError as why:
        pytest.skip(f"no disk can be mounted here: {why}")
