"""What every test may rely on: its own ROS domain on loopback, hypothesis without deadlines."""

import asyncio
import gc
import inspect
import logging
import re
import signal
import socket
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from itertools import count
from pathlib import Path
from typing import Any

import pytest
from coverage import Coverage
from hypothesis import settings

from adapters.recording import SUFFIX, RunFile
from tests.suite import CHECKOUT, ros_files
from tests.support.examples import examples
from tests.support.interface_packages import interface_package, python_path
from tests.support.kinematic import Bench
from tests.support.patience import patient_config
from tests.support.stalls import pytest_runtest_protocol as pytest_runtest_protocol

DOMAINS = range(1, 102)  # higher ids overlap the ports that Linux hands out
RESERVATION_PORT = 22119  # as domain_coordinator does, so that launch tests are respected too
FIRST_PORT, PORTS = 7400, 250  # of the UDP ports that DDS gives each domain
PARTICIPANTS_PORTS = 100  # more than the participants of a test take of them, from the first on
ASYNC_LIMIT_S = 240.0
RECORDED = 4  # of a test: those with random commands make hundreds
MAX_NAME_LENGTH = 200
_numbers = count()

settings.register_profile("rover", deadline=None, max_examples=examples(100))
settings.load_profile("rover")

# Imports and tests make much that lives on, which Python's default looks through over and over.
gc.set_threshold(50_000, 20, 20)

# A shell's background job ignores SIGINT, and so would every process that a test starts and ends.
signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_addoption(parser: pytest.Parser) -> None:
    """Offer to record what tests do: `rover bench mutants` replays it."""
    parser.addoption(
        "--recordings",
        type=Path,
        metavar="FOLDER",
        help="Record the first executives of each test, in files of a folder that exists.",
    )


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Run an `async def` test on a loop of its own, and not for ever."""
    if not inspect.iscoroutinefunction(pyfuncitem.obj):
        return None
    names = pyfuncitem._fixtureinfo.argnames
    test = pyfuncitem.obj(**{name: pyfuncitem.funcargs[name] for name in names})
    asyncio.run(asyncio.wait_for(test, ASYNC_LIMIT_S))
    return True


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Have files with a slow test begin first, so that none of them is alone in the end."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)
    real = {item.path for item in items if item.get_closest_marker("ros")}
    found = {CHECKOUT / file for file in ros_files()}
    if unmarked := sorted(str(path) for path in real - found):
        raise pytest.UsageError(f"not found by `rover test`: say mark.ros in {unmarked}")


def pytest_collection_finish() -> None:
    """Have the garbage collector pass over what was imported: it lives as long as the tests."""
    gc.collect()
    gc.freeze()


def _covers_more(test: pytest.Item) -> bool:
    """Return whether a test runs lines of the core that no other runs, as far as its marks say."""
    cases = getattr(test, "callspec", None)
    repeats = cases is not None and any(cases.indices.values())
    alike = test.get_closest_marker("alike") is not None and repeats
    return not (alike or test.get_closest_marker("at_length"))


@pytest.fixture(autouse=True)
def _repeats_without_coverage(request: pytest.FixtureRequest) -> Iterator[None]:
    """Let a test at full speed where what it covers, others cover."""
    measured = None if _covers_more(request.node) else Coverage.current()
    if measured is not None:
        measured.stop()
    yield
    if measured is not None:
        measured.start()


@pytest.fixture(autouse=True)
def _logging_as_before() -> Iterator[None]:
    """Put back what a command did to the root logger: else every later test pays for its level."""
    root = logging.getLogger()
    level, handlers = root.level, root.handlers[:]
    yield
    root.setLevel(level)
    root.handlers[:] = handlers


@contextmanager
def databases_closed() -> Iterator[None]:
    """Close the databases of what is left to die as by kill -9: Python warns of those left open."""
    opened: list[sqlite3.Connection] = []
    connect = sqlite3.connect

    def connect_and_record(*arguments: Any, **options: Any) -> sqlite3.Connection:
        opened.append(connect(*arguments, **options))
        return opened[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sqlite3, "connect", connect_and_record)
        yield
    for database in opened:
        with suppress(sqlite3.ProgrammingError):  # of another thread, which closes it itself
            database.close()


@pytest.fixture(autouse=True)
def _databases_closed() -> Iterator[None]:
    """Close the databases of a test."""
    with databases_closed():
        yield


@pytest.fixture(autouse=True)
def _connections_closed() -> Iterator[None]:
    """Charge a connection that outlives its loop to its test: Python warns in any later one."""
    left: list[asyncio.BaseTransport] = []
    close = asyncio.SelectorEventLoop.close

    def check_and_close(loop: Any) -> None:
        left.extend(each for each in loop._transports.values() if each._sock is not None)
        close(loop)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(asyncio.SelectorEventLoop, "close", check_and_close)
        yield
    assert not left, "open when their loop is closed"


@pytest.fixture(autouse=True)
def _executives_recorded(request: pytest.FixtureRequest) -> Iterator[None]:
    """Record those of benches, and those over the simulated rover in lock step."""
    folder: Path | None = request.config.getoption("--recordings")
    if folder is None:
        yield
        return
    name = re.sub(r"\W+", "-", request.node.nodeid).strip("-")[:MAX_NAME_LENGTH]
    paths = (folder / f"{name}-{number}{SUFFIX}" for number in range(RECORDED))
    from sim.rover.lockstep import LockStep  # slow to import

    make: Callable[..., None] = LockStep.__init__
    with ExitStack() as opened, pytest.MonkeyPatch.context() as patch:

        def new_tape() -> RunFile | None:
            path = next(paths, None)
            return None if path is None else opened.enter_context(closing(RunFile(path)))

        def make_recorded(lockstep: LockStep, *given: Any, **named: Any) -> None:
            tape = named.pop("tape", None) or new_tape()
            make(lockstep, *given, **named, tape=tape)

        patch.setattr(Bench, "new_tape", staticmethod(new_tape))
        patch.setattr(LockStep, "__init__", make_recorded)
        yield


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    """Give an executive over a rover without physics, on simulated time."""
    with Bench(tmp_path) as bench:
        yield bench


@contextmanager
def reserved_domain() -> Iterator[int]:
    """Hold a ROS domain id that no other test process and no running node uses."""
    with ExitStack() as held:
        for domain in DOMAINS:
            reservation = held.enter_context(socket.socket(socket.AF_INET, socket.SOCK_STREAM))
            try:
                reservation.bind(("127.0.0.1", RESERVATION_PORT + domain))
                with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as discovery:
                    discovery.bind(("", FIRST_PORT + PORTS * domain))
            except OSError:
                continue
            yield domain
            return
    raise RuntimeError("all ROS domain ids are in use")


def port_of(domain: int) -> int:
    """Return another port, TCP and UDP, that nobody else takes while the domain is held.

    A free one of those that Linux hands out may be gone before its process is there.
    """
    ours = PORTS - PARTICIPANTS_PORTS
    return FIRST_PORT + PORTS * domain + PARTICIPANTS_PORTS + next(_numbers) % ours


@pytest.fixture(scope="session")
def patient(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give a configuration whose rovers bear a machine that stalls."""
    return patient_config(tmp_path_factory.mktemp("patient"))


def _environment(patch: pytest.MonkeyPatch, domain: int, config: Path, log_dir: Path) -> None:
    patch.setenv("ROS_DOMAIN_ID", str(domain))
    patch.setenv("ROVER_CONFIG", str(config))
    for name in ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE"):
        patch.setenv(name, str(CHECKOUT / "config" / "fastdds.xml"))
    patch.setenv("ROS_LOG_DIR", str(log_dir))
    patch.delenv("ROS_AUTOMATIC_DISCOVERY_RANGE", raising=False)


@pytest.fixture
def warm_children(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fork the processes of deployments with their imports made: `tests/demo` shows real starts."""
    from sim.processes.children import ChildProcess
    from tests.support.warm import start_child

    monkeypatch.setattr(ChildProcess, "_start", start_child)


@pytest.fixture
def ros_domain(monkeypatch: pytest.MonkeyPatch, patient: Path, tmp_path: Path) -> Iterator[int]:
    """Give this test, and the processes it starts, a ROS domain of their own on loopback.

    They find patient rovers.
    """
    with reserved_domain() as domain:
        _environment(monkeypatch, domain, patient, tmp_path / "ros-log")
        yield domain


@pytest.fixture(scope="module")
def module_ros_domain(patient: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    """Give the tests of one file a ROS domain that they share, and patient rovers."""
    with reserved_domain() as domain, pytest.MonkeyPatch.context() as patch:
        _environment(patch, domain, patient, tmp_path_factory.mktemp("ros") / "log")
        yield domain


@pytest.fixture
def nav2_msgs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Give this test, and the processes that it starts, the package nav2_msgs."""
    folder = interface_package("nav2_msgs")
    if folder is not None:
        monkeypatch.syspath_prepend(folder)  # warm processes inherit it
        monkeypatch.setenv("PYTHONPATH", python_path(folder))
