"""The command `rover calibrate`: a rover's response to velocities, and its slip."""

import json
import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from adapters.process import asset_option

if TYPE_CHECKING:
    from adapters.calibration import Calibration
    from executive.settings import Settings


@click.command()
@click.argument("recording", required=False, metavar="[RUN.mcap]", type=click.Path(path_type=Path))
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
    real one drives the same as a plan (--plan), recorded. Fitted are the latency, the rotation, the
    slip that its odometry does not compensate, and the effective track; the residuals before and
    after are shown. Without --out or --write no file is written; comments in the YAML are kept.

    \b
    Examples:
      rover calibrate
      rover calibrate --cargo 20 --out jackal-loaded.yaml
      rover calibrate runs/field/run.mcap --asset config/scout.yaml --write
      rover calibrate --asset scout --plan > calibration.xml

    \b
    Exit status:
      0  done
      1  the drive is too short
      2  an argument or file is invalid
    """
    from adapters.calibration import plan_xml
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
    found = _found(recording, settings, cargo_kg, seed)
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


def _found(
    recording: Path | None, settings: "Settings", cargo_kg: float, seed: int
) -> "Calibration":
    from adapters.calibration import CalibrationError, read_drive
    from adapters.calibration import calibrate as fit
    from adapters.recording import RecordingError
    from executive.settings import SettingsError
    from sim.calibration.drive import drive_pattern

    try:
        if recording is not None:
            return fit(read_drive(recording))
        with tempfile.TemporaryDirectory(prefix="rover-calibrate-") as folder:
            path = Path(folder, "run.mcap")
            drive_pattern(settings, path, cargo_kg, seed)
            return fit(read_drive(path))
    except (RecordingError, SettingsError, ValueError) as error:
        raise click.UsageError(str(error)) from error
    except (CalibrationError, RuntimeError) as error:
        raise click.ClickException(str(error)) from error


def _write(asset: str, found: "Calibration", out: Path | None, write: bool) -> Path | None:
    """Write the asset's YAML with the new figures, and return its path; None if not requested."""
    from adapters.calibration import with_figures
    from executive.settings import SettingsError, config_folder

    own = Path(asset) if asset.endswith((".yaml", ".yml")) else config_folder() / f"{asset}.yaml"
    target = own if write else out
    if target is None:
        return None
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(with_figures(own.read_text(encoding="utf-8"), found.settings))
    except SettingsError as error:
        raise click.UsageError(f"{own}: {error}") from error
    except OSError as error:
        raise click.UsageError(f"{target} cannot be written: {error.strerror}") from error
    return target


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
            "\nslip is not fitted: neither simulation nor second odometry gives the true pose"
        )
    else:
        console.print(f"\ntrue distance over that of the odometry: {found.travel_scale:.4f}")
    console.print()
