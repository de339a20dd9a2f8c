"""The command `rover calibrate`: fits a rover's response to velocities, and its slip."""

import json
import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from adapters.process import asset_option

if TYPE_CHECKING:
    from collections.abc import Callable

    from adapters.calibration import Calibration, DriveLog
    from executive.settings import Settings


@click.command()
@click.argument("recording", required=False, metavar="[RUN.mcap]", type=click.Path(path_type=Path))
@click.option("--bag", type=click.Path(exists=True, path_type=Path), help="Fit to a bag instead.")
@click.option("--namespace", help="ROS namespace in the bag.  [default: the asset's name]")
@asset_option("Name of the rover, or path of its YAML file.")
@click.option(
    "--cargo", "cargo_kg", type=click.FloatRange(0.0), default=0.0, help="Simulated cargo in kg."
)
@click.option("--seed", type=click.IntRange(0), default=1, help="Seed of the simulated noise.")
@click.option("--out", type=click.Path(dir_okay=False, path_type=Path), help="A YAML to write.")
@click.option("--write", is_flag=True, help="Write the new figures into the asset's own YAML.")
@click.option("--plan", is_flag=True, help="Only print the pattern as a plan for the rover.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document, nothing else.")
def calibrate(
    recording: Path | None,
    bag: Path | None,
    namespace: str | None,
    asset: str,
    cargo_kg: float,
    seed: int,
    out: Path | None,
    write: bool,
    plan: bool,
    as_json: bool,
) -> None:
    """Fit the motion parameters of the settings to a drive of the rover.

    Without a recording the rover is simulated, and drives a pattern of spins, lines and arcs. A
    real one drives the same as a plan (--plan), recorded. A bag of another recorder (rosbag2 or
    ROS 1) needs the odometry, and the velocities that the base received. Fitted are the latency,
    the rotation, the slip that its odometry does not compensate, and the effective track; the
    residuals before and after are shown. Without --out or --write no file is written; comments in
    the YAML are kept.

    \b
    Examples:
      rover calibrate
      rover calibrate --cargo 20 --out jackal-loaded.yaml
      rover calibrate runs/field/run.mcap --asset config/scout.yaml --write
      rover calibrate --asset scout --bag drive.mcap --write
      rover calibrate --asset scout --plan > calibration.xml

    \b
    Exit status:
      0  done
      1  the drive is too short, or the rover did not follow its commands
      2  an argument or file is invalid
    """
    from adapters.calibration import drive_of, plan_xml, read_drive
    from executive.settings import LocomotionKind, SettingsError, load_settings

    try:
        settings = load_settings(asset)
    except SettingsError as error:
        raise click.UsageError(str(error)) from error
    if settings.locomotion is not LocomotionKind.VELOCITY:
        raise click.UsageError(
            f"{settings.asset} is not driven by velocities: there is nothing to calibrate"
        )
    if plan:
        click.echo(plan_xml(settings.drive), nl=False)
        return
    if out is not None and write:
        raise click.UsageError("--out and --write: choose one")
    if bag is not None and recording is not None:
        raise click.UsageError("RUN.mcap and --bag: choose one")
    if bag is not None:
        from adapters.ros.check import bag_drive

        found = _fitted(lambda: drive_of(settings, bag_drive(asset, bag, namespace), bag))
    elif recording is not None:
        found = _fitted(lambda: read_drive(recording))
    else:
        found = _fitted(lambda: _simulated(settings, cargo_kg, seed))
    target = _write(asset, found, out, write)
    if as_json:
        click.echo(json.dumps(asdict(found)))
        return
    _show(found)
    click.echo(
        "no file is written: use --out FILE or --write"
        if target is None
        else f"{target} has the new figures"
    )


def _simulated(settings: "Settings", cargo_kg: float, seed: int) -> "DriveLog":
    from adapters.calibration import read_drive
    from sim.calibration.drive import drive_pattern

    with tempfile.TemporaryDirectory(prefix="rover-calibrate-") as folder:
        path = Path(folder, "run.mcap")
        drive_pattern(settings, path, cargo_kg, seed)
        return read_drive(path)


def _fitted(drive: "Callable[[], DriveLog]") -> "Calibration":
    from adapters.calibration import CalibrationError
    from adapters.calibration import calibrate as fit
    from adapters.recording import RecordingError

    try:
        return fit(drive())
    except (RecordingError, ValueError) as error:  # ValueError: of a bag or the settings
        raise click.UsageError(str(error)) from error
    except (CalibrationError, RuntimeError) as error:
        raise click.ClickException(str(error)) from error


def _write(asset: str, found: "Calibration", out: Path | None, write: bool) -> Path | None:
    """Write the asset's YAML with the new figures, and return its path; None if not requested."""
    from executive.settings import (
        SettingsError,
        asset_file,
        edit_file,
        installed_warning,
        write_edits,
    )

    if out is None and not write:
        return None
    try:
        edit = edit_file(asset_file(asset), found.settings)
        if out is None:
            write_edits([edit])
        else:
            out.parent.mkdir(parents=True, exist_ok=True)
            out.write_bytes(edit.text().encode())
    except SettingsError as error:
        raise click.UsageError(str(error)) from error
    except OSError as error:
        where = error.filename or out
        raise click.UsageError(f"{where} cannot be written: {error.strerror}") from error
    if out is None and (warning := installed_warning(edit.path)):
        click.echo(warning, err=True)
    return out or edit.path


def _show(found: "Calibration") -> None:
    from rich.console import Console
    from rich.table import Table

    console = Console(highlight=False)
    figures = Table("figure", "before", "after", box=None, pad_edge=False, header_style="dim")
    for each in found.figures:
        before = "–" if each.before is None else f"{each.before:g}"
        figures.add_row(each.key, before, f"{each.after:g}")
    console.print(figures)
    left = Table(
        "residual (rms)", "before", "after", "", box=None, pad_edge=False, header_style="dim"
    )
    for rest in found.residuals:
        left.add_row(rest.name, f"{rest.before:.4f}", f"{rest.after:.4f}", rest.unit)
    console.print()
    console.print(left)
    if found.travel_scale is None:
        console.print(
            "\nthe slip in the odometry is fitted alone: neither simulation nor second odometry"
            " gives the true pose"
        )
    else:
        console.print(f"\ntrue distance over that of the odometry: {found.travel_scale:.4f}")
    console.print()
