from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.mrs.aboard import Aboard
from tests.mrs.fleet import Fleet


@pytest.fixture
def aboard(tmp_path: Path) -> Iterator[Aboard]:
    """Give a rover whose time stands still."""
    rover = Aboard(tmp_path)
    yield rover
    rover.close()


@pytest.fixture
def fleet(tmp_path: Path) -> Iterator[Fleet]:
    """Give what launches rovers that register at one another."""
    fleet = Fleet(tmp_path)
    yield fleet
    fleet.close_all()
