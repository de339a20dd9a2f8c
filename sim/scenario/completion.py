"""Shell completion of `rover scenario`: names of scenarios, and keys of `--set`."""

from collections.abc import Iterator
from typing import Any

from executive.settings import config_folder, load_settings, names_in, settings_reader
from sim.rover import World
from sim.rover.jackal import OdometrySettings
from sim.scenario.reading import scenario_folder


def scenario_names(begun: str) -> list[str]:
    """Return the names of scenarios with this prefix."""
    return [name for name in names_in(scenario_folder()) if name.startswith(begun)]


def changes(begun: str) -> list[str]:
    """Return the arguments of `--set` with this prefix: keys, and values from lists of names."""
    return [text for text in _changes() if text.startswith(begun)]


def _changes() -> Iterator[str]:
    yield from ("seed=", "lasts=", "inject=", "command.")
    yield from (f"asset={name}" for name in names_in(config_folder()))
    yield from (f"world={name}" for name in names_in(config_folder() / "worlds"))
    parts = {
        "world": World(),
        "odometry": OdometrySettings(),
        "settings": load_settings("jackal"),
    }
    reader = settings_reader({})
    for root, value in parts.items():
        yield from (f"{root}.{path}=" for path in _paths(reader.plain(value)))


def _paths(plain: dict[str, Any]) -> Iterator[str]:
    for key, value in plain.items():
        if isinstance(value, dict):
            yield from (f"{key}.{path}" for path in _paths(value))
        else:
            yield key
