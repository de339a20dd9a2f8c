"""Describes the public interface as plain data, and compares that of two versions."""

import ast
import inspect
import textwrap
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields
from enum import EnumType
from importlib.metadata import EntryPoint
from inspect import Parameter
from typing import Any, Final, cast

import click

from adapters import api
from adapters.console.process import main as console
from adapters.mal import Area, CompositeType
from adapters.mocup.brick.process import main as brick
from adapters.onboard.process import main as executive
from adapters.relay.orbiter.process import main as orbiter
from adapters.relay.rover.process import main as relay
from executive.commands import Mode, all_declarations
from executive.settings import Settings
from executive.values import parameters
from executive.values.reasons import Reason
from executive.values.reports import PlanStatus, ReportKind, Severity, Stage
from sim.ros.process import main as simulation
from tests.architecture.test_packaging import COMMANDS

Plain = dict[str, Any]

REQUIRED: Final = "required"
"""Key of the only kind of list that may become shorter, but not longer."""
_PROCESSES: Final = (console, executive, orbiter, brick, relay, simulation)
_ENUMERATIONS: Final = (
    *(Mode, parameters.Parameter, PlanStatus, Reason, ReportKind, Severity, Stage),
)
_POSITIONAL: Final = (Parameter.POSITIONAL_ONLY, Parameter.POSITIONAL_OR_KEYWORD)


def changes(before: Any, now: Any, path: str = "") -> Iterator[str]:
    """Yield each change of an interface that breaks its users: additions do not."""
    match before, now:
        case dict(), dict():
            for key, part in before.items():
                here = f"{path} {key}".strip()
                if key not in now:
                    yield f"{here}: is missing"
                elif key == REQUIRED:
                    more = [each for each in now[key] if each not in part]
                    yield from (f"{path}: {each} is required" for each in more)
                else:
                    yield from changes(part, now[key], here)
        case list(), list():
            yield from (f"{path}: {part} is missing" for part in before if part not in now)
        case _ if before != now:
            yield f"{path}: was {before}, is {now}"


def public_interface() -> Plain:
    """Return command lines, Python API, names and numbers of this version."""
    entries = (EntryPoint(name, value, "rover.commands") for name, value in COMMANDS.items())
    commands: list[click.Command] = [*(each.load() for each in entries), *_PROCESSES]
    return {
        "command line": {str(each.name): command_line(each) for each in commands},
        "python": {
            name: python(value)
            for name, value in vars(api).items()
            if not (name.startswith("_") or inspect.ismodule(value))
        },
        "names": {each.__name__: _members(each) for each in _ENUMERATIONS},
        "operations": {
            each.name: [argument.name for argument in each.arguments] for each in all_declarations()
        },
        "keys of an asset": [each.name for each in fields(Settings)],
    }


def services(area: Area) -> Plain:
    """Return operations, types and errors of an area of MAL services, as they are encoded."""
    return {
        "area": [area.number, area.version],
        "operations": {
            f"{service.name}.{each.name}": {
                "number": [service.number, each.number],
                "pattern": each.pattern.name,
                "parts": str([_parts(parts) for parts in each.parts.values()]),
                "keys": str(_parts(each.keys)),
            }
            for service in area.services
            for each in service.operations
        },
        "types": {
            each.name: {
                "short form": each.short_form,
                "content": str(_parts(each.fields))
                if isinstance(each, CompositeType)
                else {item.name: item.value for item in each.items},
            }
            for each in area.types
        },
        "errors": {each.name: each.number for each in area.errors},
    }


def _parts(parts: Any) -> list[tuple[str, str, bool]]:
    return [
        (each.name, f"{each.type.name}{'[]' * each.type.is_list}", each.nullable) for each in parts
    ]


def command_line(command: click.Command) -> Plain:
    """Return a command's options and arguments, with those of its commands."""
    shown: Plain = {REQUIRED: [each.name for each in command.params if each.required]}
    for each in command.params:
        names = each.opts if isinstance(each, click.Option) else [f"argument {each.name}"]
        shown |= dict.fromkeys([*names, *each.secondary_opts], _parameter(each))
    if isinstance(command, click.Group):
        context = click.Context(command, info_name=command.name)
        inner = {
            name: command.get_command(context, name) for name in command.list_commands(context)
        }
        shown |= {name: command_line(each) for name, each in inner.items() if each is not None}
    return shown


def _parameter(parameter: click.Parameter) -> Plain:
    shown: Plain = {"values": parameter.nargs, "repeated": parameter.multiple}
    if isinstance(parameter, click.Option):
        shown |= {"flag": parameter.is_flag}
    if isinstance(parameter.type, click.Choice):
        shown |= {"choices": [*map(str, parameter.type.choices)]}
    if isinstance(parameter, click.Option) and parameter.name != "help":
        default = parameter.to_info_dict()["default"]
        plain = isinstance(default, bool | int | float | str | None)
        shown |= {"default": default if plain else str(default)}
    return shown


def python(value: Any) -> Plain:
    """Return the members, signatures and attributes of a Python name."""
    if isinstance(value, EnumType):
        return _members(value)
    shown = _signature(value) if callable(value) else {}
    if inspect.isclass(value):
        own = {
            name: inspect.getattr_static(value, name)
            for name in dir(value)
            if not name.startswith("_") and value.__module__ != "builtins"
        }
        shown |= {name: {"attribute": True} for name in _instance_attributes(value)}
        shown |= {
            name: _signature(cast(Any, getattr(value, name)))
            if inspect.isroutine(each) or isinstance(each, classmethod | staticmethod)
            else {"attribute": True}
            for name, each in own.items()
        }
    return shown


def _instance_attributes(kind: type) -> Iterator[str]:
    """Yield the public names that the methods of a class of ours assign to `self`."""
    ours = ("adapters", "executive", "tests", "trees")
    for each in kind.__mro__:
        if each.__module__.partition(".")[0] in ours:
            tree = ast.parse(textwrap.dedent(inspect.getsource(each)))
            attributes = (node for node in ast.walk(tree) if isinstance(node, ast.Attribute))
            for node in attributes:
                name, own = node.attr, ast.unparse(node.value) == "self"
                if own and isinstance(node.ctx, ast.Store) and not name.startswith("_"):
                    yield name


def _signature(called: Callable[..., Any]) -> Plain:
    try:
        found = inspect.signature(called).parameters.values()
    except ValueError:  # of a class written in C
        return {}
    defaults = {
        f"default of ({each.name})": repr(each.default)
        for each in found
        if type(each.default) in (bool, int, float, str, type(None))
    }
    positions: Plain = {
        f"({each.name})": number if each.kind in _POSITIONAL else "by name"
        for number, each in enumerate(found)
        if each.kind not in (Parameter.VAR_POSITIONAL, Parameter.VAR_KEYWORD)
    }
    required = [
        each.name
        for each in found
        if each.default is Parameter.empty
        and each.kind not in (Parameter.VAR_POSITIONAL, Parameter.VAR_KEYWORD)
    ]
    how = {"async": inspect.iscoroutinefunction(called)}
    return {**positions, **defaults, **how, REQUIRED: required}


def _members(kind: EnumType) -> Plain:
    members: Mapping[str, Any] = kind.__members__
    return {name: each.value for name, each in members.items()}
