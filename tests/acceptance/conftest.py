"""Processes of live scenes without their imports; `tests/demo` starts them as users do."""

import pytest

from sim.processes.children import ChildProcess
from tests.support.warm import start_child


@pytest.fixture(autouse=True)
def _warm(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ChildProcess, "_start", start_child)
