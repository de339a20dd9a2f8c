"""What the command lines of the processes share."""

from argparse import ArgumentParser
from pathlib import Path

import pytest

from adapters.process.options import add_data, add_log_level, data_folder, existing_file, port


def line() -> ArgumentParser:
    found = ArgumentParser("rover-any")
    found.add_argument("--port", type=port)
    found.add_argument("--file", type=existing_file)
    add_data(found, "what it keeps")
    add_log_level(found)
    return found


def test_the_data_lie_where_they_are_told_or_with_everybodys(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    monkeypatch.delenv("ROVER_DATA", raising=False)
    assert data_folder(line().parse_args([]), "jackal") == tmp_path / "rover" / "jackal"
    monkeypatch.setenv("ROVER_DATA", "here")
    assert data_folder(line().parse_args([]), "jackal") == Path("here")
    assert data_folder(line().parse_args(["--data", "there"]), "jackal") == Path("there")


@pytest.mark.parametrize(
    ("typed", "fault"),
    [
        (["--port", "65536"], "65536 is not a port of 0 to 65535"),
        (["--port", "-1"], "-1 is not a port of 0 to 65535"),
        (["--file", "nowhere.yaml"], "there is no file nowhere.yaml"),
        (["--log-level", "loud"], "invalid choice: 'loud'"),
    ],
)
def test_what_makes_no_sense_is_refused_in_one_line(
    capsys: pytest.CaptureFixture[str], typed: list[str], fault: str
) -> None:
    with pytest.raises(SystemExit) as ended:
        line().parse_args(typed)
    assert ended.value.code == 2
    assert fault in capsys.readouterr().err.splitlines()[-1]
