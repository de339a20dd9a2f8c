"""`read_yaml` reads a settings file strictly into a dataclass; also finds `config/` and its files.

All settings of the project are read here: assets, scenarios, campaigns, the MOPS dictionary. The
one error, `SettingsError`, names the file, the key and the correct form.
"""

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, Final, TypeVar

import yaml

from executive.settings.fault_rows import settings_reader
from executive.settings.strict_reader import FormatError, StrictReader

T = TypeVar("T")

MAX_VALUE: Final = 1e10
"""Maximum value in settings: three hundred years in seconds."""

MAX_YAML_NODES: Final = 100_000
"""Maximum nodes of a YAML text with aliases expanded; the product's files have at most 500."""
MAX_YAML_DEPTH: Final = 50

_MERGE: Final = "tag:yaml.org,2002:merge"


class SettingsError(ValueError):
    """A settings file is missing or invalid; the text gives the location and the correction."""


def require_above_zero(settings: object, *names: str) -> None:
    """Raise ValueError unless each named field is None or in (0, 1e10].

    Raises:
        ValueError: a field is out of range.
    """
    for name in names:
        figure = getattr(settings, name)
        if figure is not None and not 0 < figure <= MAX_VALUE:
            raise ValueError(f"{name} must be above 0 and at most {MAX_VALUE:g}, not {figure}")


def structure(raw: object, kind: type[T], origin: str) -> T:
    """Convert the plain data of a file to a value of a settings dataclass.

    Raises:
        SettingsError: a key is unknown, missing, or of the wrong kind.
    """
    with faults_of(origin):
        return _reader().read(raw, kind)


def unstructure(value: object) -> object:
    """Return a value as plain data, the inverse of `structure`."""
    return _reader().plain(value)


@contextmanager
def faults_of(origin: object) -> Iterator[None]:
    """Convert errors of the data format to errors that name the file.

    Raises:
        SettingsError: the data do not fit.
    """
    try:
        yield
    except FormatError as error:
        raise SettingsError(error.text_of(origin)) from error


@cache
def _reader() -> StrictReader:
    """Return the reader of settings, which compiles code for each dataclass on first use."""
    return settings_reader(units=True)


class _Loader(yaml.CSafeLoader):
    """Rejects a duplicate key, which YAML would override; reads 1e-5 as a number.

    A key such as on, which YAML reads as true, is rejected, too.

    YAML 1.1, as PyYAML reads it, requires a point and a sign: 1.0e-5.
    """


def _mapping(loader: _Loader, node: yaml.MappingNode) -> dict[Any, Any]:
    seen = set()
    for key, _ in node.value:
        if key.tag == _MERGE:
            continue
        name = loader.construct_object(key, deep=True)
        fault = f"duplicate key {name!r}" if name in seen else ""
        if isinstance(name, bool):
            fault = f"key {key.value} means {name} in YAML: quote it"
        if fault:
            raise yaml.constructor.ConstructorError(None, None, fault, key.start_mark)
        seen.add(name)
    return loader.construct_mapping(node, deep=True)


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)[eE][-+]?\d+$"),
    list("-+.0123456789"),
)
_Loader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _mapping)


def load_yaml(path: Path) -> object:
    """Return the data of an untrusted YAML file, or raise a single kind of error.

    Raises:
        SettingsError: the file cannot be read, or is not YAML.
    """
    return parse_yaml(_text(path), str(path))


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise SettingsError(f"{path}: cannot be read ({error.strerror})") from error
    except ValueError as error:
        raise _not_yaml(str(path), error) from error


def parse_yaml(text: str, origin: str) -> object:
    """Return the data of a YAML text; `origin` names it in errors.

    Raises:
        SettingsError: not YAML, nested too deeply, or too large with its aliases expanded.
    """
    try:
        fault = _oversize(text)
        read = None if fault else yaml.load(text, Loader=_Loader)
    except (yaml.YAMLError, ValueError, TypeError) as error:  # a date or key may be invalid
        raise _not_yaml(origin, error) from error
    if fault:
        raise SettingsError(f"{origin}: {fault}")
    return read


def _oversize(text: str) -> str | None:
    """Return an error if a YAML text is too large to be loaded and traversed, or None.

    Loading shares the nodes of an alias, but a traversal visits them each time. Sizes are summed
    without expanding aliases.
    """
    sizes: dict[str | None, int] = {}
    nodes: list[tuple[str | None, int]] = [(None, 0)]
    for event in yaml.parse(text, Loader=yaml.CSafeLoader):
        anchor, size = getattr(event, "anchor", None), 1
        match event:
            case yaml.CollectionStartEvent():
                nodes.append((anchor, size))
                if len(nodes) > MAX_YAML_DEPTH:
                    return f"is nested too deeply, {MAX_YAML_DEPTH} levels are allowed"
                continue
            case yaml.CollectionEndEvent():
                anchor, size = nodes.pop()
            case yaml.AliasEvent():
                size = sizes.get(anchor, 1)
            case yaml.ScalarEvent():
                pass
            case _:
                continue
        sizes[anchor] = size
        outer, total = nodes.pop()
        nodes.append((outer, total + size))
        if total + size > MAX_YAML_NODES:
            return f"has more than {MAX_YAML_NODES} nodes, its aliases expanded"
    return None


def _not_yaml(origin: str, error: Exception) -> SettingsError:
    return SettingsError(f"{origin}: is not YAML ({' '.join(str(error).split())})")


def read_yaml(path: Path, kind: type[T]) -> T:
    """Return the contents of a YAML file as a settings dataclass.

    Raises:
        SettingsError: the file cannot be read, is not YAML, or does not fit.
    """
    hashable: Any = kind
    value: T = _structured(_text(path), hashable, str(path))
    return value


@lru_cache(maxsize=16)
def _structured(text: str, kind: Any, origin: str) -> Any:
    """Return the value of a text. Cached: a campaign reads the same asset hundreds of times."""
    return structure(parse_yaml(text, origin), kind, origin)


def config_folder() -> Path:
    """Return the configuration folder: $ROVER_CONFIG, the checkout, or the installation."""
    override = os.environ.get("ROVER_CONFIG")
    return Path(override) if override else shipped_folder("config")


def shipped_folder(name: str) -> Path:
    """Return a folder of the checkout, or of the installation; it need not exist."""
    checkout = Path(__file__).resolve().parents[2] / name
    if checkout.is_dir():
        return checkout
    prefix = Path(__file__).parents[5]  # for pip and colcon installs alike
    return prefix / "share" / "rover_executive" / name


def named_file(kind: str, name: str, folder: Path) -> Path:
    """Return the YAML file of a name in a folder; the kind is for the error.

    Raises:
        SettingsError: no such file; the text lists the names.
    """
    path = folder / f"{name}.yaml"
    if path.is_file():
        return path
    names = ", ".join(names_in(folder)) or f"none, {folder} has no YAML file"
    raise SettingsError(f"there is no {kind} {name!r}; there are: {names}")


def names_in(folder: Path) -> list[str]:
    """Return the names of the YAML files in a folder; `jackal.ros.yaml` is not one of them."""
    return sorted(path.stem for path in folder.glob("*.yaml") if "." not in path.stem)
