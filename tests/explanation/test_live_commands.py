"""`rover log`, `why` and `watch`, typed beside a rover that runs, over a socket."""

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from adapters.cli.main import main
from executive.commands import Command, MoveForward, Resume, Stop
from executive.values.reports import Identity, Severity
from tests.explanation.case import Case
from tests.explanation.live import LiveBench
from tests.mrs.aboard import Aboard, rover

ANY = Case("any", lambda _: None, None, None)
ROVER = "from adapters.cli.main import main; main()"


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveBench]:
    """Give a rover on which a stop ended a drive, and that refused a drive and was resumed then."""
    with LiveBench(tmp_path_factory.mktemp("rover"), ANY) as bench:
        bench.drive_on()
        bench.submit(Stop(), 2)
        bench.run(1.0)
        bench.submit(MoveForward(1.0), 3)
        bench.send(Command(Identity("LAB", 3), Resume(), "relay"))
        bench.run(0.5)
        yield bench


def typed(bench: LiveBench, *arguments: str) -> Result:
    return bench.serve(lambda: CliRunner().invoke(main, [*arguments, "--to", bench.uri]))


def test_the_log_has_each_command_on_a_line(bench: LiveBench) -> None:
    result = typed(bench, "log")
    assert result.exit_code == 0, result.output
    first, second, third, fourth = result.output.splitlines()
    assert first.startswith("2027-01-15 08:00:0")
    assert "MOE:1 moveForward distance 5 m (direct): accepted" in first
    assert first.endswith("stopped by MOE:2 (STOPPED 801)")
    assert "MOE:2 stop (direct): " in second
    assert "MOE:3 moveForward distance 1 m (direct): REJECTED" in third
    assert "LAB:3 resume (relay): accepted" in fourth


@pytest.mark.parametrize(
    ("options", "lines"),
    [
        (("--command", "MOE:2"), 1),
        (("--command", "3"), 2),
        (("--command", "MOE:9"), 0),
        (("--command", "MOE:1", "--unfold"), 4),
        (("--source", "LAB"), 1),
        (("--severity", "warning"), 2),
        (("--since", "0.6"), 2),
        (("--until", "1.6"), 1),
        (("--mode", "stopped"), 2),
        (("--json",), 4),
    ],
)
def test_the_log_is_filtered(bench: LiveBench, options: tuple[str, ...], lines: int) -> None:
    result = typed(bench, "log", *options)
    assert result.exit_code == 0, result.output
    assert len(result.output.splitlines()) == lines, result.output


def test_why_is_given_for_a_command_and_for_now(bench: LiveBench) -> None:
    reported = typed(bench, "why", "MOE:1").output
    assert reported.startswith("MOE:1 moveForward distance 5 m was cancelled: stopped by MOE:2")
    assert "MOE requested stop over the direct link, as number 2" in reported
    assert typed(bench, "why").output.startswith("IDLE: standing: no motion goal")
    assert json.loads(typed(bench, "why", "MOE:1", "--json").output)["reason"] == "STOPPED"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("why", "MOE:9"), "the latest known: MOE:1, MOE:2, MOE:3, LAB:3"),
        (("why", "3"), "name one of MOE:3, LAB:3"),
        (("why", "MOE"), "neither NUMBER nor SOURCE:NUMBER"),
        (("why", "9" * 40), "neither NUMBER nor SOURCE:NUMBER"),
        (("why", "--at", "1"), "--at needs --file"),
        (("log", "--file", "run.mcap"), "choose one"),
        (("log", "--follow", "--mode", "safe"), "--follow excludes"),
        (("watch", "--asset", "jackal"), "choose one"),
    ],
)
def test_invalid_input_is_reported(
    bench: LiveBench, arguments: tuple[str, ...], message: str
) -> None:
    result = typed(bench, *arguments)
    assert result.exit_code == 2, result.output
    assert message in result.output


def test_watch_prints_the_tree(bench: LiveBench) -> None:
    result = typed(bench, "watch", "--once")
    assert result.exit_code == 0, result.output
    head, why, *_ = result.output.splitlines()
    assert head.split()[:3] == ["jackal", "IDLE", "tick"]
    assert why == "standing: no motion goal"
    assert "? rover" in result.output


def test_the_log_is_followed(bench: LiveBench) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", ROVER, "log", "--follow", "--source", "LAB", "--to", bench.uri],
        stdout=subprocess.PIPE,
        text=True,
    )
    with process:
        assert process.stdout is not None
        past = [bench.serve(process.stdout.readline) for _ in range(4)]
        bench.executive.report_event(Severity.ALARM, "of another")
        bench.submit(MoveForward(0.1), 4)
        bench.send(Command(Identity("LAB", 5), MoveForward(1000.0), "direct"))
        events = [bench.serve(process.stdout.readline) for _ in range(2)]
        process.send_signal(signal.SIGINT)
        assert process.wait() == 130
    assert [line.split()[2:4] for line in past] == [
        ["LAB:3", stage] for stage in ("RECEIVED", "ACCEPTED", "STARTED", "EXECUTED")
    ]
    assert [line.split()[2:4] for line in events] == [["LAB:5", "RECEIVED"], ["LAB:5", "REJECTED"]]
    assert "OUT_OF_RANGE" in events[1]


def test_the_content_of_the_ledger_is_shown_after_a_restart(bench: LiveBench) -> None:
    bench.crash()
    reported = typed(bench, "why", "MOE:1").output
    assert reported.startswith("MOE:1 moveForward distance 5 m was cancelled: stopped by MOE:2")
    assert "MOE requested stop over the direct link" in reported
    assert "over the direct link" in reported
    assert len(typed(bench, "log", "--severity", "warning").output.splitlines()) >= 2


def test_commands_beyond_its_memory_are_shown_from_the_ledger(tmp_path: Path) -> None:
    with LiveBench(tmp_path, ANY, stored=3) as bench:
        bench.drive_on()
        bench.submit(Stop(), 2)
        bench.run(1.0)
        bench.submit(Resume(), 3)
        assert len(typed(bench, "log").output.splitlines()) == 1
        assert len(typed(bench, "log", "--since", "1min").output.splitlines()) == 3
        reported = typed(bench, "why", "MOE:1").output
        assert reported.startswith("MOE:1 moveForward distance 5 m was cancelled: stopped by MOE:2")
        assert "MOE requested stop over the direct link" in reported


def test_without_a_history_service_reports_are_shown(tmp_path: Path) -> None:
    aboard = Aboard(tmp_path)
    try:
        aboard.do(lambda bench: bench.submit(MoveForward(1000.0), 1))
        for arguments, message in (
            (["log"], "MOE:1 moveForward: REJECTED"),
            (["why", "MOE:1"], "MOE:1 moveForward was refused: "),
            (["why", "MOE:2"], "no command MOE:2"),
        ):
            assert message in rover(*arguments, "--to", aboard.uri).output
    finally:
        aboard.close()


def test_an_absent_rover_is_reported(tmp_path: Path) -> None:
    with LiveBench(tmp_path, ANY) as bench:
        uri = bench.uri
    for arguments in (["log"], ["why"], ["watch"]):
        result = CliRunner().invoke(main, [*arguments, "--to", uri])
        assert result.exit_code == 3, result.output
        assert "no answer at" in result.output
