"""Child processes that end by themselves: started again once they were up, else an error."""

import asyncio
import os
import re
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from sim.processes.children import ChildError, ChildProcess, ProcessGroup

UP = re.compile("Serving HTTP")
LIMIT_S = 60.0


@contextmanager
def server(folder: Path, host: str, up: re.Pattern[str] | None) -> Iterator[ChildProcess]:
    options = ("--bind", host, "0")
    child = ChildProcess("server", "http.server", options, folder, {"PYTHONUNBUFFERED": "1"}, up)
    try:
        yield child
    finally:
        child.end()


async def watch(child: ChildProcess, kills: int) -> None:
    """Watch it, and kill it each time that it is up."""
    async with asyncio.timeout(LIMIT_S), asyncio.TaskGroup() as group:
        guard = group.create_task(ProcessGroup(child).guard())
        for number in range(kills + 1):
            while len(UP.findall(child.log.read_text("utf-8"))) <= number:
                await asyncio.sleep(0.02)
            if number < kills:
                os.kill(child.pid, signal.SIGKILL)
        guard.cancel()


def test_a_child_that_was_up_is_started_again_and_retains_its_log(tmp_path: Path) -> None:
    with server(tmp_path, "127.0.0.1", UP) as child:
        asyncio.run(watch(child, kills=2))


@pytest.mark.parametrize(("host", "up"), [("no.such.host.invalid", UP), ("127.0.0.1", None)])
def test_a_child_that_was_never_up_or_is_not_to_be_started_again_is_an_error(
    tmp_path: Path, host: str, up: re.Pattern[str] | None
) -> None:
    with server(tmp_path, host, up) as child, pytest.raises(ExceptionGroup) as found:
        asyncio.run(watch(child, kills=1))
    assert found.group_contains(ChildError)


def test_a_folder_of_the_user_hides_no_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "http").mkdir()
    (tmp_path / "http" / "__init__.py").touch()
    monkeypatch.chdir(tmp_path)
    with server(tmp_path, "127.0.0.1", UP) as child:
        asyncio.run(watch(child, kills=0))
