import pytest

from tests.mocup.brick.routing import Bench


@pytest.fixture
def bench() -> Bench:
    """Give a router between two links and a brick that is there."""
    return Bench()
