from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.plans import PlanBench


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[PlanBench]:
    """Give an executive that knows plans, on a rover without physics."""
    with PlanBench(tmp_path) as bench:
        yield bench
