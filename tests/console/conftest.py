"""Rovers in lock step, or running by themselves many times as fast as real time."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import pytest
from playwright import async_api, sync_api
from sqlalchemy import Engine

from adapters.console.archive import open_database
from adapters.recording import RunFile
from executive.settings import AuthoritySettings
from sim.scenario.lockstep_run import run_in_lock_step
from sim.scenario.model import RunMode
from sim.scenario.reading import load_scenario
from tests.console.postgres import NEEDED as POSTGRES_NEEDED
from tests.console.postgres import cluster, fresh
from tests.console.site import LIMIT_MS, close_shared_browser
from tests.mrs.aboard import Aboard

NEEDED = AuthoritySettings(needed=True, lease_s=3600.0)

Launch = Callable[..., Aboard]

async_api.expect.set_options(timeout=LIMIT_MS)
sync_api.expect.set_options(timeout=LIMIT_MS)


@pytest.fixture(scope="session", autouse=True)
def _browser_closed() -> Iterator[None]:
    """End the browser of the tests with them."""
    yield
    close_shared_browser()


@pytest.fixture
def launch(tmp_path: Path) -> Iterator[Launch]:
    """Give what launches rovers, which land with the test."""
    with ExitStack() as launched:

        def launch(name: str = "jackal", **settings: Any) -> Aboard:
            rover = Aboard(tmp_path / name, asset=name, **settings)
            return launched.enter_context(closing(rover))

        yield launch


@pytest.fixture
def rover(launch: Launch) -> Aboard:
    """Give a rover whose time runs, which anybody may command."""
    rover = launch()
    rover.runs = True
    return rover


@pytest.fixture
def guarded(launch: Launch) -> Aboard:
    """Give a rover whose time runs, and whose commands need the authority."""
    rover = launch(authority=NEEDED)
    rover.runs = True
    return rover


@pytest.fixture(scope="session")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give the recording of a drive, a turn and a picture, one after the other."""
    return record("drive3m_turn_picture", tmp_path_factory.mktemp("drive"))


def record(scenario: str, folder: Path) -> Path:
    """Play a scenario of the product, and return its recording."""
    with pytest.MonkeyPatch.context() as patch, closing(RunFile(folder / "run.mcap")) as tape:
        patch.delenv("ROVER_CONFIG", raising=False)  # a site of another test has its own
        run_in_lock_step(load_scenario(scenario, RunMode.LOCK_STEP), folder / "data", tape)
    return folder / "run.mcap"


@pytest.fixture(scope="session")
def postgres() -> Iterator[str]:
    """Give the URL of a PostgreSQL of our own."""
    if not POSTGRES_NEEDED:
        pytest.skip("PostgreSQL is not installed: apt install postgresql")
    with cluster() as started:
        yield started.url


@pytest.fixture(params=["sqlite", "postgresql"])
def engine(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Engine]:
    """Give an archive's database that is empty, once of each kind."""
    if request.param == "sqlite":
        engine = open_database(None, tmp_path)
    else:
        url: str = request.getfixturevalue("postgres")
        engine = open_database(fresh(url), tmp_path)
    yield engine
    engine.dispose()
