"""`rover files`, and the commands that change the folder, as typed."""

import json
import re
import subprocess
import sys
from pathlib import Path
from zlib import crc32

import pytest
from click.testing import Result

from executive.commands import TakePicture
from tests.mrs.aboard import Aboard, rover
from tests.mrs.test_command_command import ROVER, command
from tests.support.kinematic import PICTURE


@pytest.fixture
def picture(aboard: Aboard) -> str:
    """Give the path of a picture aboard."""
    (outcome,) = aboard.carry_out(TakePicture())
    assert outcome.executed
    (path,) = aboard.do(lambda bench: list(bench.executive.files.paths()))
    return path


def files(aboard: Aboard, *arguments: str) -> Result:
    operation, *rest = arguments
    return rover("files", operation, "--to", aboard.uri, *rest)


def test_files_are_listed_and_described(aboard: Aboard, picture: str) -> None:
    for folder in ((), ("pictures",)):
        listed = files(aboard, "list", *folder)
        assert listed.exit_code == 0
        assert f"{picture} " in listed.output
    reported = files(aboard, "info", picture)
    assert reported.exit_code == 0
    assert f"{len(PICTURE)} octets" in reported.output
    assert f"{crc32(PICTURE):08x}" in reported.output
    assert {"commandId", "POS_X", "CAM_PAN"} <= set(reported.output.split())
    assert re.search(r"modified +[-0-9]+ [:0-9]+ UTC\n", reported.output)
    assert re.search(r"POS_X +[-.0-9e]+ m\n", reported.output)
    assert re.search(r"CAM_PAN +[-.0-9e]+°\n", reported.output)


def test_a_file_is_fetched_to_where_it_is_wanted(
    aboard: Aboard, picture: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)
    name = Path(picture).name
    assert files(aboard, "fetch", picture).exit_code == 0
    assert (here / name).read_bytes() == PICTURE
    assert files(aboard, "fetch", picture, "rock.jpg").exit_code == 0
    again = files(aboard, "fetch", picture, "rock.jpg")
    assert again.exit_code == 2
    assert "--force" in again.output
    (here / "rock.jpg").write_bytes(b"old")
    assert files(aboard, "get", picture, "rock.jpg", "--force", "--chunk", "2").exit_code == 0
    assert (here / "rock.jpg").read_bytes() == PICTURE
    assert sorted(path.name for path in here.iterdir()) == sorted([name, "rock.jpg"])


@pytest.mark.parametrize(
    "typed",
    ["list nothing", "list ../x", "info nothing", "get nothing there.jpg", "cancel nothing"],
)
def test_an_absent_file_fails_with_a_text(aboard: Aboard, typed: str) -> None:
    failed = files(aboard, *typed.split())
    assert failed.exit_code == 1
    assert failed.output == f"Error: NotFound: {typed.split()[1]}\n"


@pytest.mark.usefixtures("picture")
def test_a_folder_cannot_be_fetched_and_is_called_so(aboard: Aboard) -> None:
    failed = files(aboard, "fetch", "pictures", "there")
    assert failed.exit_code == 1
    assert failed.output.startswith("Error: pictures is a folder: `rover files list pictures`")


def test_a_file_that_cannot_be_stored_here_fails_with_a_text(
    aboard: Aboard, picture: str, tmp_path: Path
) -> None:
    (tmp_path / "file").write_bytes(b"")
    failed = files(aboard, "fetch", picture, str(tmp_path / "file" / "rock.jpg"))
    assert failed.exit_code == 1
    assert "Error: " in failed.output
    assert "file" in failed.output


def test_a_folder_that_is_not_here_is_no_file(aboard: Aboard, picture: str, tmp_path: Path) -> None:
    result = files(aboard, "fetch", picture, f"{tmp_path}/none/")
    assert result.exit_code == 2
    assert f"folder {tmp_path}/none/ does not exist" in result.output
    assert list(tmp_path.glob("none*")) == []


def test_files_are_printed_as_json(aboard: Aboard, picture: str) -> None:
    (listed,) = map(json.loads, files(aboard, "list", "--json").output.splitlines())
    reported = json.loads(files(aboard, "info", "--json", picture).output)
    assert listed["path"] == reported["path"] == picture
    assert reported["checksum"] == crc32(PICTURE)
    assert reported["metaData"]["POS_X"] == 0.0


def test_files_are_moved_and_deleted_by_commands(aboard: Aboard, picture: str) -> None:
    assert command(aboard, "moveFile", picture, "kept/[rock].jpg").exit_code == 0
    assert "kept/[rock].jpg" in files(aboard, "list").output
    assert command(aboard, "deleteFile", "kept/[rock].jpg").exit_code == 0
    assert aboard.do(lambda bench: list(bench.executive.files.paths())) == []
    assert command(aboard, "deleteFile", "kept/[rock].jpg").exit_code == 1


def test_watching_reports_a_picture(aboard: Aboard) -> None:
    aboard.runs = True
    process = subprocess.Popen(
        [sys.executable, "-c", ROVER, "files", "watch", "--to", aboard.uri],
        stdout=subprocess.PIPE,
        text=True,
    )
    with process:
        assert process.stdout is not None
        assert "watching the files of jackal" in process.stdout.readline()
        aboard.carry_out(TakePicture())
        line = process.stdout.readline()
        process.terminate()
    assert line.split()[1] == "STORED"
    assert line.rstrip().endswith(f"{len(PICTURE)} octets")
