"""Two executives on one ledger: the second is refused."""

import os
from pathlib import Path

import pytest

from adapters.onboard.storage import StorageError, exclusive_storage
from tests.support.processes import executive, running


def test_a_folder_is_made_and_held_by_one_only(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "jackal"
    with exclusive_storage(folder) as storage:
        assert storage.ledger.parent == folder
        with (
            pytest.raises(StorageError, match=f"process {os.getpid()}.*--data"),
            exclusive_storage(folder),
        ):
            pass
    with exclusive_storage(folder):
        pass


def test_a_folder_that_cannot_be_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(StorageError, match="cannot be used"), exclusive_storage(tmp_path / "file"):
        pass


@pytest.mark.ros
@pytest.mark.usefixtures("ros_domain")
def test_a_second_process_on_one_ledger_is_refused(tmp_path: Path) -> None:
    with executive(tmp_path):
        arguments = ("--port", "0", "--data", str(tmp_path / "data"))
        with running(tmp_path / "second", "rover-executive", *arguments) as second:
            assert second.ended() == 1
            assert "another executive" in second.text
            assert "Traceback" not in second.text
