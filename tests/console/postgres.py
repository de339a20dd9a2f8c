"""A PostgreSQL cluster of a test's own, on a Unix socket, under a user that is not root."""

import os
import pwd
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path

import psycopg

from tests.support.browser import REQUIRED

LIMIT_S = 60.0
_NUMBERS = count()


def _binary(name: str) -> str | None:
    folders = [str(path) for path in Path("/usr/lib/postgresql").glob("*/bin")]
    return shutil.which(name, path=os.pathsep.join([os.environ["PATH"], *folders]))


POSTGRES = _binary("postgres")
NEEDED = REQUIRED or POSTGRES is not None
"""CI has it; elsewhere a test that needs one is skipped where it is not installed."""


@contextmanager
def cluster() -> Iterator[str]:
    """Start one; gives the URL of its database."""
    initdb, postgres = _binary("initdb"), POSTGRES
    assert initdb is not None, "apt install postgresql"
    assert postgres is not None
    user = _user()
    with tempfile.TemporaryDirectory(prefix="pg", ignore_cleanup_errors=True) as folder:
        os.chown(folder, user.pw_uid, user.pw_gid)
        data = Path(folder) / "data"
        options: dict[str, object] = {"user": user.pw_uid, "group": user.pw_gid, "cwd": folder}
        if os.getuid() != 0:
            options = {"cwd": folder}
        made = subprocess.run(
            [initdb, "-D", data, "-U", "console", "-A", "trust", "-E", "UTF8", "--no-sync"],
            capture_output=True,
            check=False,
            **options,  # type: ignore[call-overload]
        )
        assert made.returncode == 0, made.stderr.decode()
        log = (Path(folder) / "log").open("wb")
        served = subprocess.Popen(
            [postgres, "-D", data, "-k", folder, "-c", "listen_addresses=", "-c", "fsync=off"],
            stdout=log,
            stderr=log,
            **options,  # type: ignore[call-overload]
        )
        try:
            url = f"postgresql://console@/postgres?host={folder}"
            _await(url, served)
            yield url
        finally:
            served.terminate()
            served.wait(60)
            log.close()


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


def _await(url: str, served: "subprocess.Popen[bytes]") -> None:
    deadline_s = time.monotonic() + LIMIT_S
    while True:
        try:
            psycopg.connect(url).close()
            return
        except psycopg.OperationalError:
            assert served.poll() is None, "postgres ended"
            assert time.monotonic() < deadline_s
            time.sleep(0.05)
