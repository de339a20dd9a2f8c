"""A process's folder, which it has to itself."""

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from adapters.process import StartError, exclusive

HOLD_WHERE_NOTHING_CAN_GROW = """
import resource, sys
from pathlib import Path
from adapters.process import StartError, exclusive
resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
try:
    with exclusive(Path(sys.argv[1]), "lock"):
        print("it is held")
except StartError as error:
    print(error)
"""


def test_a_folder_is_made_and_held_by_one_only(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "jackal"
    with (
        exclusive(folder, "lock"),
        pytest.raises(StartError, match=rf"another process \({os.getpid()}\).*--data"),
        exclusive(folder, "lock"),
    ):
        pass
    with exclusive(folder, "lock"), exclusive(folder, "another"):
        pass


def test_a_folder_that_cannot_be_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(StartError, match="cannot be used: File exists; --data names another"),
        exclusive(tmp_path / "file", "lock"),
    ):
        pass


def test_a_free_lock_names_no_holder(tmp_path: Path) -> None:
    with exclusive(tmp_path, "lock"):
        assert (tmp_path / "lock").read_text() == f"{os.getpid()}\n"
    assert (tmp_path / "lock").read_text() == ""


def test_a_full_disk_is_reported_with_the_folder(tmp_path: Path) -> None:
    requested = subprocess.run(
        (sys.executable, "-c", HOLD_WHERE_NOTHING_CAN_GROW, str(tmp_path)),
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=True,
    )
    why = f"{tmp_path} cannot be written: {os.strerror(errno.EFBIG)}; free some space, or name"
    assert requested.stdout.startswith(why)
