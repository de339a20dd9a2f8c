"""Rovers, and sessions with them: an asynchronous test has a `client` or a `consumer`."""

from collections.abc import Iterator
from inspect import iscoroutinefunction, signature
from pathlib import Path
from typing import Any

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
def running(aboard: Aboard) -> Iterator[Aboard]:
    """Give a rover whose time runs by itself."""
    aboard.runs = True
    yield aboard
    aboard.runs = False


@pytest.fixture
def client(aboard: Aboard) -> Aboard:
    """Give an asynchronous test an `MrsClient` that is connected with the rover."""
    return aboard


@pytest.fixture
def consumer(aboard: Aboard) -> Aboard:
    """Give an asynchronous test a `Consumer`: operations by name, parts as they are."""
    return aboard


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Run an asynchronous test within a session with its rover."""
    test = pyfuncitem.obj
    if not iscoroutinefunction(test):
        return None
    given: dict[str, Any] = {name: pyfuncitem.funcargs[name] for name in signature(test).parameters}
    if "client" in given:
        given["client"].ground(lambda client: test(**given | {"client": client}))
    else:
        given["consumer"].consume(lambda consumer: test(**given | {"consumer": consumer}))
    return True


@pytest.fixture
def fleet(tmp_path: Path) -> Iterator[Fleet]:
    """Give what launches rovers that register at one another."""
    fleet = Fleet(tmp_path)
    yield fleet
    fleet.close_all()
