"""The command `rover replay`: checks that the core decides as it did in a recorded run."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

if TYPE_CHECKING:
    from adapters.recording.replay import ChangedReport, Difference, ReplayResult

SAME: Final = 0
DIFFERS: Final = 1
BAD_FILE: Final = 2


@click.command()
@click.argument("files", nargs=-1, required=True, metavar="RUN.mcap...", type=click.Path())
@click.option(
    "--with",
    "settings",
    metavar="ASSET",
    help="Replay with the settings of this asset or YAML file, and list the reports that differ.",
)
@click.option("--markdown", is_flag=True, help="Print a table, as for a folder, also for files.")
@click.option("--json", "as_json", is_flag=True, help="Print the table as JSON.")
@click.option(
    "--judge/--no-judge", default=True, help="Judge each difference of a folder by a fork."
)
@click.option("--jobs", type=click.IntRange(1), help="Number of processes.  [default: all cores]")
def replay(
    files: tuple[str, ...],
    settings: str | None,
    markdown: bool,
    as_json: bool,
    judge: bool,
    jobs: int | None,
) -> None:
    """Replay recorded runs through the core, and compare its decisions.

    The core receives the same inputs at the same times as in the run: settings, ledger, facts,
    commands. Each velocity, report, answer, tree change, mode change and published parameter must
    be equal to the last bit. The first difference is shown, with the tree if a node differs from
    the recording.

    `rover scenario FILE --out DIR` records runs. Replay them after a change of the code: the
    differences are its effects. For a folder all recordings in it are replayed, in parallel, and
    grouped by their first different decision: a table in Markdown. Each that differs is simulated
    again, as by `rover whatif`, and judged by the contacts and the ends of its commands: better,
    worse or the same. That needs the extra sim.

    \b
    Examples:
      rover replay runs/motion_forward/run.mcap
      rover replay runs
      rover replay run.mcap --with jackal
      rover replay run.mcap --with changed.yaml
      rover replay runs --with changed.yaml --json

    \b
    Exit status:
      0  all decisions are the same
      1  a decision differs
      2  a file is not a recording, or of another asset; the others are replayed
    """
    from adapters.recording.container import RecordingError
    from adapters.recording.replay import replay as play
    from executive.settings import SettingsError, load_settings

    try:
        others = None if settings is None else load_settings(settings)
    except SettingsError as error:
        raise click.UsageError(str(error)) from error
    recordings, statuses = _recordings(files), []
    if markdown or as_json or any(map(Path.is_dir, map(Path, files))):
        from adapters.recording import regressions

        found = regressions.compare(recordings, others, jobs)
        found = regressions.judge(found, settings, jobs) if judge and found.groups else found
        click.echo(json.dumps(found.document(), default=str) if as_json else found.markdown())
        raise SystemExit(BAD_FILE if found.unusable else DIFFERS if found.groups else SAME)
    for path in recordings:
        try:
            replayed = play(path, others)
        except RecordingError as error:
            click.echo(f"Error: {error}", err=True)
            statuses.append(BAD_FILE)
            continue
        click.echo(f"{path}: {_summary(replayed)}")
        if replayed.difference is None:
            statuses.append(SAME)
        else:
            _show(replayed.difference)
            statuses.append(DIFFERS)
        _list(replayed.reports)
    if len(statuses) > 1:
        click.echo(f"{statuses.count(SAME)} of {len(statuses)} recordings decide the same")
    raise SystemExit(max(statuses))


def _recordings(files: tuple[str, ...]) -> list[Path]:
    """Return the given recordings and those in given folders, without their continuation files.

    Raises:
        click.UsageError: a folder contains no recording.
    """
    from adapters.recording.run_file import first_parts

    found: list[Path] = []
    for path in map(Path, files):
        inside = first_parts(path) if path.is_dir() else [path]
        if not inside:
            raise click.UsageError(f"{path}: contains no recording (*.mcap)")
        found += inside
    return found


def _summary(replayed: "ReplayResult") -> str:
    found = replayed.difference
    if found is None:
        starts = "" if replayed.starts == 1 else f", {replayed.starts} starts"
        end = "" if replayed.whole else "; the recording is truncated there"
        return (
            f"{replayed.decisions} decisions in {replayed.ticks} ticks are the same"
            f" ({replayed.duration_s:.1f} s{starts}){end}"
        )
    position = f"in entry {found.number} ({found.entry})"
    lines = [f"decisions differ after {found.time_s:.2f} s, {position}", *found.lines]
    return "\n  ".join(lines)


def _show(difference: "Difference") -> None:
    if difference.then:
        from rich.console import Console

        from trees.screen import render_nodes

        Console(highlight=False).print(render_nodes(difference.tree, difference.then))


def _list(reports: "tuple[ChangedReport, ...]") -> None:
    for each in reports:
        report = each.report
        stage = report.severity.name if report.stage is None else report.stage.name
        when = "recorded" if each.recorded else "replayed"
        about = [str(report.identity or ""), stage, report.text]
        click.echo(f"  {when} at {each.time_s:.2f} s: {'  '.join(filter(None, about))}")
