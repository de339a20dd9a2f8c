"""The command `rover replay`: whether the core decides as it did in a recorded run."""

from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

if TYPE_CHECKING:
    from adapters.recording.replay import Replayed

DIFFERS: Final = 1
BAD_FILE: Final = 2


@click.command()
@click.argument("files", nargs=-1, required=True, metavar="RUN.mcap...", type=click.Path())
def replay(files: tuple[str, ...]) -> None:
    """Replay recorded runs through the core, and compare what it decides.

    The core gets what it got in the run, at the same times: settings, ledger, facts, commands. Each
    velocity, report and answer, each change of the tree, the mode and the parameters that were sent
    must be the same, to the last bit. The first that is not is shown.

    `rover scenario FILE --out DIR` records runs. Replay them after a change of the code: what
    differs is what the change does to them.

    \b
    Examples:
      rover replay runs/motion_forward/run.mcap
      rover replay runs/*/run.mcap

    \b
    Exit status:
      0  all decisions are the same
      1  one is not
      2  a file is no recording
    """
    from adapters.recording.replay import replay as play
    from adapters.recording.run_file import RecordingError

    troubles = set()
    for file in files:
        try:
            replayed = play(Path(file))
        except RecordingError as error:
            click.echo(f"Error: {error}", err=True)
            troubles.add(BAD_FILE)
            continue
        click.echo(f"{file}: {_told(replayed)}")
        if replayed.difference is not None:
            troubles.add(DIFFERS)
    raise SystemExit(max(troubles, default=0))


def _told(replayed: "Replayed") -> str:
    found = replayed.difference
    if found is None:
        lives = "" if replayed.lives == 1 else f", {replayed.lives} starts"
        end = "" if replayed.whole else "; the recording breaks off there"
        return (
            f"{replayed.decisions} decisions in {replayed.ticks} ticks are the same"
            f" ({replayed.duration_s:.1f} s{lives}){end}"
        )
    place = f"in entry {found.number} ({found.entry})"
    lines = [f"another decision after {found.time_s:.2f} s, {place}", *found.lines]
    return "\n  ".join(lines)
