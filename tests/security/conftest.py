from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.mrs.aboard import Aboard


@pytest.fixture
def aboard(tmp_path: Path) -> Iterator[Aboard]:
    """Give a rover whose time stands still, served over the direct link."""
    rover = Aboard(tmp_path)
    yield rover
    rover.close()
