"""Two nodes joined by hand, and their clock."""

from pathlib import Path

import pytest

from tests.bundle.nodes import Clock, TestedNode, settings_of


@pytest.fixture
def clock() -> Clock:
    """Give the wall clock of both nodes."""
    return Clock()


@pytest.fixture
def pair(tmp_path: Path, clock: Clock) -> tuple[TestedNode, TestedNode]:
    """Give ipn:1 and ipn:2, neighbours."""
    return (
        TestedNode(tmp_path, settings_of(1, 2), clock),
        TestedNode(tmp_path, settings_of(2, 1), clock),
    )
