"""The command `rover bag`: converts a recording to a rosbag2 folder, for the tools of ROS."""

from pathlib import Path

import click


@click.command()
@click.argument("recording", metavar="RUN.mcap", type=click.Path(dir_okay=False, path_type=Path))
@click.argument("folder", metavar="FOLDER", type=click.Path(path_type=Path))
def bag(recording: Path, folder: Path) -> None:
    """Convert a recorded run to a rosbag2 folder.

    It contains the ROS topics of such a rover: odometry, sensors, /tf, velocities, reports
    (/rosout) and the tree, with the names of ASSET.ros.yaml; of simulations also the true pose.

    \b
    Example:
      rover bag run.mcap run_bag
      ros2 bag info run_bag
    """
    from adapters.recording import RecordingError
    from adapters.ros.bag import write_bag
    from executive.settings import SettingsError

    if folder.exists():
        raise click.UsageError(f"{folder} exists: give a new folder")
    try:
        counts = write_bag(recording, folder)
    except (RecordingError, SettingsError) as error:
        raise click.UsageError(str(error)) from error
    except OSError as error:
        raise click.ClickException(f"{folder} cannot be written: {error.strerror}") from error
    for topic, count in sorted(counts.items()):
        click.echo(f"{count:7}  {topic}")
