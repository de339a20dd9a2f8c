"""`rover-console` as a process, as users start it."""

import json
import signal
import urllib.request
from pathlib import Path

import pytest
from click.testing import CliRunner

from adapters.console.process import main
from tests.support.processes import running


def test_it_serves_until_a_signal_and_takes_its_archive_up_again(tmp_path: Path) -> None:
    for _ in range(2):
        arguments = ("--to", "127.0.0.1:1", "--port", "0", "--data", str(tmp_path / "data"))
        with running(tmp_path / "log", "rover-console", *arguments) as process:
            address = process.output(r"(http://127.0.0.1:\d+/)")
            process.output(r"maltcp://127.0.0.1:1/MRS .*is down: no answer at")
            with urllib.request.urlopen(f"{address}api/dictionary", timeout=60) as answer:
                reported = json.load(answer)
                assert (reported["assets"], reported["console"]["commands"]) == ({}, [])
            assert process.end(signal.SIGTERM) == 0
            assert "Traceback" not in process.text


@pytest.mark.parametrize(
    ("typed", "status", "message"),
    [
        (["--to", "a/b"], 2, "--to: 'a/b' is not host, host:port"),
        (["--tls-certificate", "FILE"], 2, "HTTPS needs both"),
        (["--host", "0.0.0.0"], 1, "give --tokens FILE (lines NAME TOKEN) for"),
        (["--tokens", "FILE"], 1, "has no line NAME TOKEN"),
        (["--archive", "mysql://x/y"], 1, "write sqlite:///FILE or postgresql://"),
        (["--max-days", "0"], 2, "is not in the range x>0"),
    ],
)
def test_an_error_is_reported_in_one_line(
    typed: list[str], status: int, message: str, tmp_path: Path
) -> None:
    empty = tmp_path / "empty"
    empty.touch()
    given = [str(empty) if each == "FILE" else each for each in typed]
    ended = CliRunner().invoke(main, [*given, "--port", "0", "--data", str(tmp_path / "data")])
    assert (ended.exit_code, message in ended.output) == (status, True), ended.output
