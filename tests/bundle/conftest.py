"""Tests of this folder may be coroutines, each on a loop of its own; two nodes joined by hand."""

import asyncio
import inspect
from pathlib import Path

import pytest

from tests.bundle.nodes import Clock, TestedNode, settings_of


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Run a test that is a coroutine function."""
    if not inspect.iscoroutinefunction(pyfuncitem.obj):
        return None
    names = inspect.signature(pyfuncitem.obj).parameters
    asyncio.run(pyfuncitem.obj(**{name: pyfuncitem.funcargs[name] for name in names}))
    return True


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
