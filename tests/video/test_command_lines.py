"""Where the stream goes, as the settings and the command lines say it."""

from pathlib import Path

import click
import pytest
import yaml
from click.testing import CliRunner

from adapters.cli.main import main as rover
from adapters.onboard.process import main
from executive.settings import SettingsError, VideoSettings, config_folder, load_settings
from sim.ros.process import main as rover_sim

USAGE = 2


def settings_file(folder: Path, video: dict[str, object] | None) -> Path:
    """Write settings of a Jackal with another section video, or none."""
    settings = yaml.safe_load((config_folder() / "jackal.yaml").read_text())
    del settings["video"]
    file = folder / "scout.yaml"
    file.write_text(yaml.safe_dump(settings if video is None else {**settings, "video": video}))
    return file


def test_the_jackal_has_a_video_stream() -> None:
    assert load_settings("jackal").video == VideoSettings("127.0.0.1", 5004, "127.0.0.1", 5006)


def test_an_asset_needs_none(tmp_path: Path) -> None:
    assert load_settings(str(settings_file(tmp_path, None))).video is None


@pytest.mark.parametrize(
    "change", [{"to_port": 0}, {"listen_port": 65536}, {"to_host": None}, {"codec": "h264"}]
)
def test_settings_that_make_no_sense(tmp_path: Path, change: dict[str, object]) -> None:
    video = {"listen_host": "a", "listen_port": 1, "to_host": "b", "to_port": 2, **change}
    if video["to_host"] is None:
        del video["to_host"]
    with pytest.raises(SettingsError, match="video"):
        load_settings(str(settings_file(tmp_path, video)))


@pytest.mark.parametrize(
    ("process", "option"),
    [(main, "--video-to"), (main, "--video-from"), (rover_sim, "--video-to"), (rover, "--at")],
)
@pytest.mark.parametrize("at", ["here", "here:0", ":5006", "here:70000", "here:port"])
def test_no_address_is_a_usage_error(process: click.Command, option: str, at: str) -> None:
    typed = [option, at] if process is not rover else ["video", option, at]
    done = CliRunner().invoke(process, typed)
    assert done.exit_code == USAGE
    assert "is not HOST:PORT" in done.output


def test_an_asset_without_video_cannot_be_told_where_to(tmp_path: Path) -> None:
    typed = ["--asset", str(settings_file(tmp_path, None)), "--video-to", "192.0.2.7:5006"]
    done = CliRunner().invoke(main, typed)
    assert done.exit_code == USAGE
    assert "its settings have no section video" in done.output
