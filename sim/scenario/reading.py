"""A scenario file into a `Scenario`, or one error that names the file and the key."""

from functools import partial
from pathlib import Path
from typing import Any, Final

import yaml

from executive.commands import Request
from executive.settings import Settings, SettingsError, config_folder, load_settings, named_file
from sim.rover import World, WorldError, load_world
from sim.scenario.checks import check, check_play_mode
from sim.scenario.expectations import After
from sim.scenario.model import PlayMode, Scenario
from sim.scenario.requests import read_request
from sim.scenario.strict import FormatError, StrictReader

_MERGE: Final = "tag:yaml.org,2002:merge"


class YamlError(Exception):
    """A file holds no YAML that can be used; the text says why, without the file's name."""


class _Loader(yaml.CSafeLoader):
    """Refuses a key that is said twice, where YAML would forget the first."""


def _mapping(loader: _Loader, node: yaml.MappingNode) -> dict[Any, Any]:
    seen = set()
    for key, _ in node.value:
        if key.tag == _MERGE:
            continue
        name = loader.construct_object(key, deep=True)
        if name in seen:
            raise yaml.constructor.ConstructorError(
                None, None, f"key {name!r} is said twice", key.start_mark
            )
        seen.add(name)
    return loader.construct_mapping(node, deep=True)


_Loader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _mapping)


def load_yaml(path: Path) -> object:
    """Return what a YAML file holds.

    Raises:
        YamlError: the file cannot be read, or is not YAML.
    """
    try:
        return yaml.load(path.read_text(encoding="utf-8"), Loader=_Loader)
    except OSError as error:
        raise YamlError(f"cannot be read ({error.strerror})") from error
    except RecursionError as error:
        raise YamlError("is nested too deeply") from error
    except (yaml.YAMLError, ValueError, TypeError) as error:  # a date or key may be none
        raise YamlError(f"is not YAML ({' '.join(str(error).split())})") from error


SUFFIXES: Final = (".yaml", ".yml")


class ScenarioError(Exception):
    """A scenario cannot be used; the text names the file and the key at fault."""


def scenario_folder() -> Path:
    """Return where the scenarios lie that have a name."""
    return config_folder() / "scenarios"


def load_scenario(name: str, how: PlayMode | None = None) -> Scenario:
    """Read a scenario.

    Args:
        name: a path, or the name of a file in config/scenarios.
        how: it is to be played, which not every scenario can be each way; None for not at all.

    Raises:
        ScenarioError: there is no such scenario, or it says what no scenario can say.
    """
    path = Path(name)
    if path.name == name and path.suffix not in SUFFIXES:
        try:
            path = named_file("scenario", name, scenario_folder())
        except SettingsError as error:
            raise ScenarioError(str(error)) from error
    try:
        scenario = _scenario(load_yaml(path), path.parent)
        check(scenario)
        if how is not None:
            check_play_mode(scenario, how)
    except (FormatError, YamlError) as error:
        raise ScenarioError(f"{path}: {error}") from error
    return scenario


def _scenario(raw: object, folder: Path) -> Scenario:
    if not isinstance(raw, dict):
        raise FormatError("", "a scenario is keys and values, such as title, timeline, expect")
    asked = partial(read_request, folder=folder)
    reader = StrictReader({After: _after, Request: asked})
    settings = _settings(raw.get("asset", "jackal"), folder)
    filled = {
        **raw,
        "settings": reader.overlay(settings, raw.get("settings", {}), "settings"),
        "world": _world(raw.get("world", "flat"), folder, reader),
    }
    return reader.read(filled, Scenario, "")


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
    except (SettingsError, WorldError) as error:
        raise FormatError("world", " ".join(str(error).split())) from error


def _after(raw: Any, path: str) -> After:
    try:
        return After.parse(_text(raw, path))
    except ValueError as error:
        raise FormatError(path, str(error)) from error


def _name(raw: object, path: str) -> str:
    name = _text(raw, path)
    if not name.isprintable():
        raise FormatError(path, f"{name!r} is no name")
    return name


def _text(raw: object, path: str) -> str:
    if not isinstance(raw, str):
        raise FormatError(path, f"expected a text, got {raw!r}")
    return raw
