"""The class that speaks with the rover of an asset, as the asset's settings name it."""

from collections.abc import Callable
from importlib import import_module
from types import ModuleType
from typing import Final, assert_never

from rclpy.node import Node

from adapters.ros.asset import RosMotionRover, RosVelocityRover
from adapters.ros.parameters import Topics
from adapters.ros.rover import RosRover
from executive.ports import Clock
from executive.settings import Settings, SettingsError, Way

RosRoverKind = Callable[[Node, Topics, Clock, Settings], RosVelocityRover | RosMotionRover]
"""Makes what speaks with a rover: of the node, the topics of every asset, the core's clock."""

FORM: Final = "module:Class, such as adapters.onboard.mocup:MocupOnRos"


def rover_kind(settings: Settings) -> RosRoverKind:
    """Return the class for an asset: the one that it names, or that of rovers on `cmd_vel`.

    Raises:
        SettingsError: there is none of that name, or the rover cannot be moved by it in the way
            that `locomotion` says; the text says which there are, or what it lacks.
    """
    port = _port(settings.locomotion)
    if settings.rover is None:
        if _missing(RosRover, port):
            raise SettingsError(
                f"{settings.asset}: locomotion {settings.locomotion.value} needs the key rover:"
                f" {FORM}"
            )
        return RosRover
    kind = _named(settings.rover, port)
    missing = _missing(kind, port)
    if missing:
        raise SettingsError(
            f"{settings.asset}: rover {settings.rover} lacks {', '.join(missing)}: with"
            f" locomotion {settings.locomotion.value} it has to be a {port.__module__}."
            f"{port.__name__}"
        )
    return kind


def _port(way: Way) -> type:
    match way:
        case Way.VELOCITY:
            return RosVelocityRover
        case Way.WHOLE_MOTION:
            return RosMotionRover
        case _:
            assert_never(way)


def _named(name: str, port: type) -> type:
    place, _, kind = name.partition(":")
    if not (place and kind):
        raise SettingsError(
            f"rover {name!r} is not of the form {FORM}; who takes cmd_vel needs no key rover"
        )
    try:
        module = import_module(place)
    except ImportError as error:
        raise SettingsError(
            f"rover {name}: {error}; the module has to be installed beside rover-executive, or to"
            " lie in a folder of PYTHONPATH"
        ) from error
    found = getattr(module, kind, None)
    if not isinstance(found, type):
        there = ", ".join(_fitting(module, port)) or "none that could be it"
        raise SettingsError(f"rover {name}: {place} has no class {kind!r}; there are: {there}")
    return found


def _fitting(module: ModuleType, port: type) -> list[str]:
    """Return the names of a module's own classes that have all that a port asks for."""
    return sorted(
        name
        for name, found in vars(module).items()
        if isinstance(found, type)
        and found.__module__ == module.__name__
        and not _missing(found, port)
    )


def _missing(kind: type, port: type) -> list[str]:
    """Return the methods of a port that a class does not have."""
    wanted = {
        name
        for base in port.__mro__
        for name, value in vars(base).items()
        if callable(value) and not name.startswith("_")
    }
    return sorted(name for name in wanted if not callable(getattr(kind, name, None)))
