"""A scenario file into a `Scenario`, or one error that names the file and the key."""

from pathlib import Path
from typing import Final

from executive.commands import Request
from executive.settings import (
    Settings,
    SettingsError,
    config_folder,
    load_settings,
    load_yaml,
    named_file,
)
from sim.rover import World, load_world
from sim.scenario.checks import check, check_play_mode
from sim.scenario.model import PlayMode, Scenario
from sim.scenario.moments import After
from sim.scenario.requests import read_request
from sim.scenario.strict import FormatError, StrictReader

SUFFIXES: Final = (".yaml", ".yml")


def scenario_folder() -> Path:
    """Return where the scenarios lie that have a name."""
    return config_folder() / "scenarios"


def load_scenario(name: str, mode: PlayMode | None = None) -> Scenario:
    """Read a scenario.

    Args:
        name: a path, or the name of a file in config/scenarios.
        mode: it is to be played, which not every scenario can be each way; None for not at all.

    Raises:
        SettingsError: there is no such scenario, or it says what no scenario can say.
    """
    path = Path(name)
    if path.name == name and path.suffix not in SUFFIXES:
        path = named_file("scenario", name, scenario_folder())
    try:
        scenario = _scenario(load_yaml(path), path.parent)
        check(scenario)
        if mode is not None:
            check_play_mode(scenario, mode)
    except FormatError as error:
        raise SettingsError(f"{path}: {error}") from error
    return scenario


def _scenario(raw: object, folder: Path) -> Scenario:
    if not isinstance(raw, dict):
        raise FormatError("", "a scenario is keys and values, such as title, timeline, expect")
    reader = StrictReader(
        {
            After: lambda raw: After.parse(_text(raw, "")),
            Request: lambda raw: read_request(raw, folder, reader),
        }
    )
    settings = _settings(raw.get("asset", "jackal"), folder)
    filled = {
        **raw,
        "settings": reader.overlay(settings, raw.get("settings", {}), "settings"),
        "world": _world(raw.get("world", "flat"), folder, reader),
    }
    return reader.read(filled, Scenario)


def _settings(asset: object, folder: Path) -> Settings:
    name = _name(asset, "asset")
    try:
        return load_settings(str(folder / name) if name.endswith(SUFFIXES) else name)
    except SettingsError as error:
        raise FormatError("asset", str(error)) from error


def _world(raw: object, folder: Path, reader: StrictReader) -> World:
    if not isinstance(raw, str):
        return reader.read(raw, World, "world")
    name = _name(raw, "world")
    beside = name.endswith(SUFFIXES)
    try:
        path = folder / name if beside else named_file("world", name, config_folder() / "worlds")
        return load_world(path)
    except SettingsError as error:
        raise FormatError("world", " ".join(str(error).split())) from error


def _name(raw: object, path: str) -> str:
    name = _text(raw, path)
    if not name.isprintable():
        raise FormatError(path, f"{name!r} is no name")
    return name


def _text(raw: object, path: str) -> str:
    if not isinstance(raw, str):
        raise FormatError(path, f"expected a text, got {raw!r}")
    return raw
