"""Mission control plays scenarios over a real socket, to a rover whose time runs fast."""

import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console
from rich.text import Text

from adapters.mrs.ground.client import MrsClient
from executive.commands import Mode
from executive.values.reports import Stage
from sim.demo.display import LineDisplay, TerminalDisplay, commands_table, status_line
from sim.scenario.model import RunMode
from sim.scenario.record import Answer, Record, SeenStatus
from sim.scenario.sent import sent_commands
from tests.demo.playing import play
from tests.mrs.aboard import Aboard

FORWARD = "\n- {at: 0, command: {moveForward: {distance: 0.2}}, label: go}"
AGAIN = "\n- {after: go ENDED, repeat: go}"


@pytest.fixture
def aboard(tmp_path: Path) -> Iterator[Aboard]:
    rover = Aboard(tmp_path)
    rover.runs = True
    yield rover
    rover.close()


def played(
    aboard: Aboard,
    folder: Path,
    text: str,
    on_update: Callable[[Record], None] = lambda _: None,
    lasts_s: float = 60.0,
) -> Record:
    async def session(_: MrsClient) -> Record:
        return await play(folder, RunMode.DIRECT, {"direct": aboard.uri}, text, on_update, lasts_s)

    return aboard.ground(session)


def test_a_scenario_is_played_to_its_end(aboard: Aboard, tmp_path: Path) -> None:
    seen: set[tuple[str, Stage | None]] = set()

    def on_update(record: Record) -> None:
        seen.update((sent.title, sent.stage) for sent in sent_commands(record))

    record = played(
        aboard,
        tmp_path,
        """
- {at: 0, command: {moveTo: {x: 90, y: 0}}, label: far}
- {after: far STARTED, command: {setCameraAngles: {pan: 0.5, tilt: 0}}}
- {after: far STARTED, command: stop}
- {after: stop ENDED, command: {moveForward: {distance: 1}}, label: refused}
- {after: refused ENDED, command: resume}
- {after: resume ENDED, command: {moveForward: {distance: -0.5}}, label: back}
- {after: back ENDED, repeat: back}
""",
        on_update,
    )
    far, camera, stop, refused, resume, back, again = sent_commands(record)
    assert [each.ending for each in (far, stop, refused, resume, back, again)] == [
        "CANCELLED",
        "EXECUTED",
        "REJECTED",
        "EXECUTED",
        "EXECUTED",
        "DUPLICATE",
    ]
    assert camera.ending is not None
    assert far.text.endswith("(reason 801)")
    assert "send resume first" in refused.text
    assert str(back.sending.identity.command_id) in again.text
    assert (back.title, Stage.EXECUTED) in seen
    assert record.statuses[-1].values["POS_X"] < 0.0


def test_every_report_is_kept_in_order_with_link_and_time(aboard: Aboard, tmp_path: Path) -> None:
    back = "\n- {after: go ENDED + 0.1, command: {moveForward: {distance: -0.2}}, label: back}"
    record = played(aboard, tmp_path, FORWARD + AGAIN + back)
    numbers = dict.fromkeys(report.sequence for report in record.reports)
    assert list(numbers) == list(range(1, len(numbers) + 1))
    assert [each.report for each in record.receipts] == record.reports
    assert {each.link for each in record.receipts} == {"direct"}
    times_s = [each.time_s for each in record.receipts]
    assert times_s == sorted(times_s)
    assert [each.answer for each in record.sendings] == [
        Answer.ACCEPTED,
        Answer.DUPLICATE,
        Answer.ACCEPTED,
    ]
    assert "already used command id 1" in record.sendings[1].text


def test_a_play_ends_without_a_command_that_never_does(aboard: Aboard, tmp_path: Path) -> None:
    aboard.runs = False
    record = played(aboard, tmp_path, FORWARD, lasts_s=2.0)
    (sent,) = sent_commands(record)
    assert sent.ending is None
    assert record.simulated_s >= 2.0


def test_output_that_is_no_terminal_is_lines_and_a_table(aboard: Aboard, tmp_path: Path) -> None:
    console = Console(width=110)
    with console.capture() as printed, LineDisplay(console) as shown:
        played(aboard, tmp_path, FORWARD, shown.view(["direct"]).on_update)
    lines = [line for line in printed.get().splitlines() if "moveForward distance 0.2 m" in line]
    assert [line.split()[6] for line in lines[:2]] == ["STARTED", "EXECUTED"]
    assert "\x1b" not in printed.get()


def test_an_old_status_is_shown_with_its_age() -> None:
    fresh = SeenStatus(20.0, 0.1, "direct", Mode.IDLE, {})
    assert "old" not in status_line(fresh).plain
    assert status_line(replace(fresh, age_s=5.2)).plain.endswith("5.2 s old")


def test_on_a_narrow_terminal_each_command_remains_on_its_line(
    aboard: Aboard, tmp_path: Path
) -> None:
    screen = StringIO()
    console = Console(file=screen, force_terminal=True, width=80, height=24)
    beyond = "\n- {after: go ENDED, command: {moveForward: {distance: 1.0e+6}}}"
    with TerminalDisplay(console) as shown:
        record = played(aboard, tmp_path, FORWARD + beyond, shown.view(["direct"]).on_update)
    with console.capture() as printed:
        console.print(commands_table(list(sent_commands(record)), brief=True))
    drawn = Text.from_ansi(printed.get()).plain.splitlines()
    assert [line.split()[0] for line in drawn] == ["#", "1", "2"]
    assert all(len(line) <= 80 for line in drawn)
    assert "1e+06 m is above its bound" in re.sub(r"\s+", " ", last_table(screen.getvalue()))


def last_table(screen: str) -> str:
    """Return what stands on the screen after all that was drawn over, in one column."""
    lines = Text.from_ansi(screen[screen.rindex("received") :]).plain.splitlines()
    return " ".join(line[60:] for line in lines)
