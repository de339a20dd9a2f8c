"""A PostgreSQL cluster of a test's own, on a Unix socket, under a user that is not root."""

import os
import pwd
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from itertools import count
from pathlib import Path

import psycopg

from tests.support.browser import REQUIRED

LIMIT_S = 60.0
INITDB = ("-U", "console", "-A", "trust", "-E", "UTF8", "--no-sync")
_NUMBERS = count()


def _binary(name: str) -> str | None:
    folders = [str(path) for path in Path("/usr/lib/postgresql").glob("*/bin")]
    return shutil.which(name, path=os.pathsep.join([os.environ["PATH"], *folders]))


POSTGRES = _binary("postgres")
NEEDED = REQUIRED or POSTGRES is not None
"""CI has it; elsewhere a test that needs one is skipped where it is not installed."""


class Cluster:
    """One that runs, or was killed.

    Args:
        folder: where it is.

    Attributes:
        url: of its database.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.url = f"postgresql://console@/postgres?host={folder}"
        self._options: dict[str, object] = {"cwd": folder}
        if os.getuid() == 0:
            user = _user()
            os.chown(folder, user.pw_uid, user.pw_gid)
            self._options |= {"user": user.pw_uid, "group": user.pw_gid}
        initdb = _binary("initdb")
        assert initdb is not None, "apt install postgresql"
        made = subprocess.run(
            [initdb, "-D", folder / "data", *INITDB],
            capture_output=True,
            check=False,
            **self._options,  # type: ignore[call-overload]
        )
        assert made.returncode == 0, made.stderr.decode()
        self.start()

    def start(self) -> None:
        """Start it, again maybe, and wait until it answers."""
        assert POSTGRES is not None
        command = [POSTGRES, "-D", self._folder / "data", "-k", self._folder]
        command += ["-c", "listen_addresses=", "-c", "fsync=off"]
        with (self._folder / "log").open("ab") as log:
            self._served = subprocess.Popen(
                command,
                stdout=log,
                stderr=log,
                start_new_session=True,
                **self._options,  # type: ignore[call-overload]
            )
        deadline_s = time.monotonic() + LIMIT_S
        while True:
            try:
                psycopg.connect(self.url).close()
                return
            except psycopg.OperationalError:
                assert self._served.poll() is None, (self._folder / "log").read_text()
                assert time.monotonic() < deadline_s
                time.sleep(0.05)

    def kill(self) -> None:
        """End it as kill -9 does, with all its processes."""
        os.killpg(self._served.pid, signal.SIGKILL)
        self._served.wait(LIMIT_S)

    def close(self) -> None:
        self._served.terminate()
        self._served.wait(LIMIT_S)


@contextmanager
def cluster() -> Iterator[Cluster]:
    """Start one."""
    with (
        tempfile.TemporaryDirectory(prefix="pg", ignore_cleanup_errors=True) as folder,
        closing(Cluster(Path(folder))) as started,
    ):
        yield started


def _user() -> pwd.struct_passwd:
    if os.getuid() != 0:
        return pwd.getpwuid(os.getuid())
    try:
        return pwd.getpwnam("postgres")
    except KeyError:
        return pwd.getpwnam("nobody")


def fresh(url: str) -> str:
    """Return the URL of a new database in a cluster."""
    name = f"archive{next(_NUMBERS)}"
    with psycopg.connect(url, autocommit=True) as connection:
        connection.execute(f"CREATE DATABASE {name}".encode())
    return url.replace("/postgres?", f"/{name}?")
