"""The command `rover robot check`: whether an asset's files fit its robot, live or in a bag."""

import json
import math
import sys
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from adapters.ros.check import CheckResult
    from executive.settings import FileEdit


@click.command()
@click.argument("asset")
@click.option(
    "--seconds",
    # Fast DDS repeats a lost announcement of a publisher after 3 s.
    type=click.FloatRange(4.0, 600.0),
    default=10.0,
    show_default=True,
    help="Time of listening.",
)
@click.option("--drive", is_flag=True, help="Drive half a metre and turn by 90 degrees: IT MOVES.")
@click.option("--yes", is_flag=True, help="With --drive, drive without a question.")
@click.option("--bag", type=click.Path(exists=True, path_type=Path), help="Check a bag instead.")
@click.option("--write", is_flag=True, help="Write the changes into the two files of the asset.")
@click.option("--namespace", help="ROS namespace of the robot.  [default: the asset's name]")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document, nothing else.")
@click.pass_context
def check(
    ctx: click.Context,
    asset: str,
    seconds: float,
    drive: bool,
    yes: bool,
    bag: Path | None,
    write: bool,
    namespace: str | None,
    as_json: bool,
) -> None:
    """Check whether the files of an asset fit its robot.

    It listens to the topics, and prints for each whether it is there and fits, its rate and its
    stamps; then the figures of the sensors, and the YAML sections to change, which --write writes;
    comments in the files stay. Only --drive moves the robot, and Ctrl-C stops it. A bag
    (rosbag2 or ROS 1) is also played through the fault monitors.

    \b
    Examples:
      rover robot check scout
      rover robot check scout --drive --write
      rover robot check robots/clearpath_j100 --namespace j100_0001
      rover robot check scout --bag drive.mcap

    \b
    Exit status:
      0  everything fits
      1  there are problems
      2  an argument or file is invalid
    """
    from adapters.ros.check import BagError, DriveError, check_bag, check_robot
    from executive.settings import SettingsError

    if drive and bag is not None:
        raise click.UsageError("--drive moves a robot: it cannot be used with --bag")
    if drive and not yes and not sys.stdin.isatty():
        raise click.UsageError("--drive requests a confirmation: without a terminal add --yes")

    def on_drive(text: str) -> None:
        click.echo(text, err=True)
        if not yes:
            click.confirm("Is the ground ahead free?", abort=True, err=True)

    if bag is None and not as_json:
        click.echo(f"Listening for {seconds:g} s ...", err=True)
    try:
        if bag is not None:
            found = check_bag(asset, bag, namespace)
        else:
            found = check_robot(asset, seconds, namespace, on_drive if drive else None)
    except (SettingsError, BagError) as error:
        raise click.UsageError(str(error)) from error
    except DriveError as error:
        raise click.ClickException(str(error)) from error
    if not as_json:
        _show(found, write)
    written = _write(found.changes, as_json) if write else []
    if as_json:
        sections = {each.path.name: each.sections for each in found.changes}
        plain = asdict(replace(found, changes=()))
        click.echo(json.dumps(_plain(plain) | {"changes": sections, "written": written}))
    ctx.exit(0 if found.fits else 1)


def _write(edits: "tuple[FileEdit, ...]", quiet: bool) -> list[str]:
    """Write the files that differ, and return their paths."""
    from executive.settings import SettingsError, installed_warning, write_edits

    changed = [each for each in edits if each.summary]
    try:
        write_edits(changed)
    except SettingsError as error:
        raise click.UsageError(f"{error}; nothing is written") from error
    except OSError as error:
        text = f"{error.filename} cannot be written: {error.strerror}; nothing is written"
        raise click.UsageError(text) from error
    for each in changed:
        if warning := installed_warning(each.path):
            click.echo(f"Warning: {warning}", err=True)
        if not quiet:
            click.echo(f"{each.path}: {each.summary}")
    if not quiet:
        click.echo("written: check again" if changed else "nothing to change: no file is written")
    return [str(each.path) for each in changed]


def _plain(value: Any) -> Any:
    """Return a value with null for NaN, which JSON lacks."""
    if isinstance(value, dict):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _show(found: "CheckResult", write: bool) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = Console(highlight=False, soft_wrap=True, width=None if sys.stdout.isatty() else 120)
    table = Table("topic", "Hz", "gap s", "stamp age s", "", box=None, pad_edge=False)
    for each in found.topics:
        cells, timing = ["", "", ""], each.timing
        if timing is not None:
            cells = [f"{timing.rate_hz:.1f}", f"{timing.gap_s:.3f}", "no stamp"]
            if math.isfinite(timing.age_s):
                cells[2] = f"{timing.age_s:.3f} ± {timing.jitter_s / 2:.3f}"
        table.add_row(f"{each.key}  {each.topic}", *cells, "!" if each.problems else "ok")
    console.print(table)
    for each in found.topics:
        if each.key == "cmd_vel" and each.peers:
            console.print(Text(f"- velocities are received by {', '.join(each.peers)}"))
        for problem in each.problems:
            console.print(Text(f"! {each.key}: {problem}"))
    for advice in found.advices:
        console.print(Text(f"{'! ' if advice.is_problem else '- '}{advice.text}"))
    for fault in found.faults:
        console.print(Text(f"! {fault}"))
    changes = () if write else found.changes
    for edit in changes:
        click.echo(f"Change in {edit.path.name}:")
        click.echo("".join(f"  {line}\n" for line in edit.sections.splitlines()), nl=False)
    fits = "everything fits; the changes are optional" if changes else "everything fits"
    click.echo(fits if found.fits else "there are problems: see the lines above")
