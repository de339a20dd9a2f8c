"""A recorded run is looked at moment by moment, and bad input is told."""

import json
import re
from collections.abc import Iterator
from pathlib import Path

import click
import pytest
from click.testing import CliRunner, Result

from adapters.cli import watch_file
from adapters.cli.watch import watch
from adapters.recording import Moment, RecordedMoments
from tests.support.browser import ARTIFACTS, BROWSER, REQUIRED, open_page
from trees import DisplayStatus, display_statuses


def typed(*arguments: object) -> Result:
    return CliRunner().invoke(watch, list(map(str, arguments)), catch_exceptions=False)


def test_a_moment_has_its_tree_its_pose_and_its_commands(stuck: Path) -> None:
    recorded = RecordedMoments(stuck)
    moment = recorded.moments[recorded.index_at(1.5)]
    assert round(moment.time_s, 2) == 1.5
    seen = dict(
        zip(
            [n.name for n in moment.snapshot.nodes],
            display_statuses(moment.snapshot.nodes),
            strict=True,
        )
    )
    assert seen["drive"] is seen["rover"] is DisplayStatus.RUNNING
    assert seen["stopping?"] is seen["priority stop"] is DisplayStatus.DECLINED, "that is healthy"
    assert DisplayStatus.FAILURE not in seen.values()
    drive = next(n.path for n in moment.snapshot.nodes if n.name == "drive")
    assert 0.9 < moment.since_s[drive] < 1.2
    assert moment.snapshot.mode == "MOVING"
    assert moment.pose is not None
    assert 0.05 < moment.pose.x_m < 0.3
    assert [str(each.identity) for each in moment.commands] == ["MOE:1", "MOE:2"]


@pytest.mark.parametrize(
    ("at", "reported"),
    [
        ("1.5", "1.50 of 8.00 s"),
        ("99", "8.00 of 8.00 s"),
        ("MOE:1", "2.25 of 8.00 s"),
        ("WHEELS_OFF_COMMAND", "2.25 of 8.00 s"),
    ],
)
def test_a_moment_is_found_by_time_command_and_reason(stuck: Path, at: str, reported: str) -> None:
    result = typed("--file", stuck, "--at", at)
    assert result.exit_code == 0
    assert reported in result.output
    assert "nothing to do" in result.output


def test_keys_step_and_go_to_reports(stuck: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    keys: Iterator[str] = iter(["l", "h", "j", "j", "k", ">", "<", "G", "g", "?", "q"])
    shown: list[float] = []
    monkeypatch.setattr(click, "getchar", lambda: next(keys))
    poll = watch_file._shown

    def retain(recorded: RecordedMoments, moment: Moment, height: int | None) -> object:
        shown.append(round(moment.time_s, 2))
        return poll(recorded, moment, height)

    monkeypatch.setattr(watch_file, "_shown", retain)
    watch_file.browse(stuck, "0.5")
    assert shown[:3] == [0.5, 0.55, 0.5]
    first, second, back = shown[3:6]
    assert 0.5 < first == back < second
    assert shown[6:8] == [round(back + 1, 2), back]
    assert shown[8] == 8.0
    assert shown[9] == shown[10] < 0.1


def test_the_page_holds_the_whole_run_and_needs_no_network(stuck: Path, tmp_path: Path) -> None:
    page = tmp_path / "run.html"
    assert typed("--file", stuck, "--html", page).exit_code == 0
    text = page.read_text()
    begin = text.index('id="run">') + len('id="run">')
    run = json.loads(text[begin : text.index("</script>", begin)])
    recorded = RecordedMoments(stuck)
    assert [each["time_s"] for each in run["moments"]] == [
        round(each.time_s, 3) for each in recorded.moments
    ]
    assert all(len(run["trees"][each["tree"]]) > 30 for each in run["moments"])
    ended = run["commands"][run["moments"][-1]["commands"]]
    assert ended[0][:2] == ["MOE:1", "FAILED"]
    assert not re.search(r"(src|href)=|url\(|@import|fetch\(", text)


@pytest.mark.skipif(BROWSER is None and not REQUIRED, reason="needs chromium")
def test_the_page_shows_a_moment_in_a_browser(stuck: Path, tmp_path: Path) -> None:
    page = tmp_path / "run.html"
    assert typed("--file", stuck, "--html", page).exit_code == 0
    opened = open_page(page, tmp_path, (1300, 1000), ARTIFACTS / "recorded-run.png")
    assert (opened.console, opened.requests) == ([], [])
    assert "of 8.00 s</b>" in opened.document
    assert "priority stop" in opened.document
    assert "<polyline" in opened.document


def test_bad_input_is_reported(stuck: Path, tmp_path: Path) -> None:
    for arguments, reported in (
        (("--file", stuck, "--at", "MOE:9"), "no such command"),
        (("--file", stuck), "give one time"),
        (("--file", stuck, "--once"), "--once needs a running rover"),
        (("--at", "3"), "need --file"),
        (("--file", stuck, "--html", tmp_path / "no" / "run.html"), "cannot be written"),
        (("--file", tmp_path / "none.mcap", "--at", "3"), "cannot be read"),
    ):
        result = typed(*arguments)
        assert result.exit_code == 2, result.output
        assert reported in result.output
