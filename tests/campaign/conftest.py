"""A scenario of four seconds and campaigns of it, in a folder of their own."""

from collections.abc import Callable
from pathlib import Path

import pytest

SHORT = """\
title: A short way
duration: 4
timeline:
  - {at: 0.5, command: {moveForward: {distance: 0.4}}, label: go}
expect:
  - {command: go, ends: EXECUTED}
"""
CAMPAIGN = """\
title: Short ways
scenario: short.yaml
runs: 12
seed: 3
vary:
  seed: {integers: [0, 1000]}
  world.friction: {uniform: [0.45, 0.75]}
  command.go.distance: {choice: [0.2, 0.4]}
  inject: {choice: [none, left_wheels_stuck], weights: [3, 1], at: {uniform: [0.5, 1]}}
criteria:
  - {success: 0.2}
"""
Write = Callable[..., str]


@pytest.fixture
def write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Write:
    """Give a way to write a campaign, with parts of it replaced, where the test runs."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "short.yaml").write_text(SHORT)

    def write(*replaced: tuple[str, str], text: str = CAMPAIGN) -> str:
        for old, new in replaced:
            assert old in text
            text = text.replace(old, new)
        (tmp_path / "mine.yaml").write_text(text)
        return "mine.yaml"

    return write
