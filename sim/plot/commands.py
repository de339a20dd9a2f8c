"""The command `rover plot`: a picture of a recorded run."""

from pathlib import Path

import click


@click.command()
@click.argument("recording", metavar="RUN.mcap", type=click.Path(path_type=Path))
@click.option(
    "--out",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Output file, .png or .svg.  [default: plot.png beside the recording]",
)
def plot(recording: Path, out: Path | None) -> None:
    """Draw a recorded run: its map, and commands, events, modes and speeds over time.

    Speeds are the commanded ones, those of the wheels, the odometry and the second odometry, and,
    in simulations, the true ones.

    \b
    Examples:
      rover plot runs/motion_forward/run.mcap
      rover plot run.mcap --out drive.svg
    """
    from adapters.recording import RecordingError
    from sim.drawing import write_plot

    target = recording.with_name("plot.png") if out is None else out
    if target.suffix not in {".png", ".svg"}:
        raise click.UsageError(f"--out {target}: name a file that ends in .png or .svg")
    try:
        write_plot(recording, target)
    except RecordingError as error:
        raise click.UsageError(str(error)) from error
    except OSError as error:
        raise click.UsageError(f"{target} cannot be written: {error.strerror}") from error
    click.echo(target)
