"""Storms of fixed seeds, and that they repeat; what broke a promise is in `situations.py`."""

import os
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

from tests.simulated.deeds import Storm, draw_console_storm, draw_mocup_storm, draw_storm
from tests.simulated.storm import Played, play

SEEDS = ("7", "9", "21")
"""Over LTP, TCPCL and UDP, with eclipses, operators who pass the authority on, and two rovers."""
CHECKOUT = Path(__file__).resolve().parents[2]


def early(storm: Storm) -> Storm:
    """Return a storm without the second half of its deeds: `--simulated` plays whole ones."""
    half_s = storm.deeds[-1].at_s / 2
    return replace(storm, deeds=tuple(deed for deed in storm.deeds if deed.at_s < half_s))


@cache
def storm(seed: str) -> Played:
    """Play a storm, the first of them to its end."""
    drawn = draw_storm(seed)
    return play(drawn if seed == SEEDS[0] else early(drawn))


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_no_promise_is_broken(seed: str) -> None:
    played = storm(seed)
    assert not played.findings
    assert played.kills > 10
    assert played.orders > 100


@pytest.mark.slow
def test_no_promise_is_broken_over_mocup() -> None:
    played = play(early(draw_mocup_storm(4)))
    assert not played.findings
    assert played.kills > 10


@pytest.mark.slow
def test_no_promise_is_broken_over_a_console() -> None:
    storm = draw_console_storm(9)
    played = play(replace(storm, deeds=tuple(deed for deed in storm.deeds if deed.at_s < 90.0)))
    assert not played.findings
    assert played.kills > 5


@pytest.mark.slow
def test_hours_repeat_to_the_octet_for_any_hash_seed() -> None:
    seed = SEEDS[0]
    text = subprocess.run(
        (sys.executable, "-m", "tests.simulated", "0.05", "--seed", seed),
        cwd=CHECKOUT,
        env=os.environ | {"PYTHONHASHSEED": "77"},
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    assert f"digest {storm(seed).digest[:16]}\n" in text
    assert "nothing was broken" in text
