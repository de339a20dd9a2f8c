"""Overrides of a scenario file (`--set world.friction=0.4`), applied before it is checked.

Overridden values are checked as strictly as the file.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

from executive.settings import (
    FormatError,
    SettingsError,
    config_folder,
    load_settings,
    names_in,
    parse_yaml,
    quoted,
    settings_reader,
    suggestion,
)
from sim.rover import World
from sim.rover.jackal import SimulatedOdometry

_TIMELINE: Final = ("command", "inject", "crash")
ROOTS: Final = ("seed", "world", "settings", "odometry", "asset", "duration", *_TIMELINE)
"""First components of an overridable key."""
NO_FAULT: Final = "none"
_TIMES: Final = ("at", "after", "near")
_FOR: Final = "for"


@dataclass(frozen=True, slots=True)
class Override:
    """A key of a scenario file and the value that replaces the file's.

    Attributes:
        key: dotted key of the file, such as `world.friction`, `settings.drive.travel_speed` or, in
            the timeline, `command.LABEL.ARGUMENT`; `inject` adds a fault to the timeline, `crash` a
            restart.
        value: YAML, such as `0.4`, `5deg`, `[1, 2]`; for `inject`, `{odometry_frozen, at: 3}`,
            with `for: 2` for its duration, or `none` for no fault; for `crash`,
            `{at: 3, for: 1}`, or `none`.
    """

    key: str
    value: str

    @classmethod
    def parse(cls, text: str) -> "Override":
        """Read `KEY=VALUE`.

        Raises:
            ValueError: the text has another form.
        """
        key, equals, value = text.partition("=")
        if not (equals and key.strip() and value.strip()):
            raise ValueError(f"{text!r} is not KEY=VALUE, as world.friction=0.4")
        return cls(key.strip(), value.strip())

    def __str__(self) -> str:
        return f"{self.key}={self.value}"


def apply_overrides(
    raw: dict[str, Any], changes: Sequence[Override], world: Callable[[str], dict[str, Any]]
) -> dict[str, Any]:
    """Return the plain data of a scenario with overrides applied in order.

    Args:
        raw: data of the file; not modified.
        changes: overrides to apply.
        world: returns the plain data of a world that the file names.

    Raises:
        FormatError: an override does not fit; the text names it.
    """
    made = raw
    for change in changes:
        try:
            made = _changed(made, change, world)
        except (FormatError, SettingsError, ValueError) as error:
            raise FormatError("", f"changed by {change}: {error}") from error
    return made


def _changed(
    raw: dict[str, Any], change: Override, world: Callable[[str], dict[str, Any]]
) -> dict[str, Any]:
    root, _, rest = change.key.partition(".")
    value = parse_yaml(change.value, "the value")
    match root:
        case "inject" if not rest:
            return _with_fault(raw, value)
        case "crash" if not rest:
            return _with_crash(raw, value)
        case "command" if rest:
            return _with_argument(raw, rest, value)
        case "world" if rest and isinstance(raw.get("world", "flat"), str):
            raw = {**raw, "world": world(raw.get("world", "flat"))}
        case "world" if isinstance(value, str) and not rest:
            value = world(value)
        case "world" | "settings" | "odometry":
            pass
        case "seed" | "asset" | "duration" if not rest:
            pass
        case _:
            raise ValueError(_unknown_key_text(change.key))
    made: dict[str, Any] = replaced(raw, change.key.split("."), value)
    return made


def _unknown_key_text(key: str) -> str:
    near = suggestion(key.partition(".")[0], ROOTS)
    return f"no key {key!r} can be changed{near}; a key begins with one of {', '.join(ROOTS)}"


def replaced(raw: Any, path: Sequence[str], value: Any) -> Any:
    """Return data with a value set at a path; missing intermediate keys are created."""
    if not path:
        return value
    first, *rest = path
    if isinstance(raw, list):
        index = int(first) if first.isdecimal() else -1
        if not 0 <= index < len(raw):
            raise ValueError(f"{first!r} is no index in a list of {len(raw)}, which begins with 0")
        return [*raw[:index], replaced(raw[index], rest, value), *raw[index + 1 :]]
    if raw is not None and not isinstance(raw, dict):
        raise ValueError(f"the value {quoted(raw)} has no key {first!r}")
    within = raw or {}
    return {**within, first: replaced(within.get(first), rest, value)}


def _with_fault(raw: dict[str, Any], value: object) -> dict[str, Any]:
    """Return data with a fault and its end, if any, added to the timeline; NO_FAULT adds none."""
    if value in (NO_FAULT, None):
        return raw
    given = value if isinstance(value, dict) else {}
    faults = [key for key in given if key not in (*_TIMES, _FOR)]
    if len(faults) != 1:
        raise ValueError(
            "expected a fault and its time, as {odometry_frozen, at: 3}, or none; YAML needs the"
            " space after a colon"
        )
    name = faults[0]
    fault = name if given[name] in (None, {}) else {name: given[name]}
    begins = {**{key: given[key] for key in _TIMES if key in given}, "inject": fault}
    entries = [begins] if _FOR not in given else [begins, _end(name, given)]
    return {**raw, "timeline": [*(raw.get("timeline") or []), *entries]}


def _with_crash(raw: dict[str, Any], value: object) -> dict[str, Any]:
    """Return data with a crash of the executive added to the timeline; NO_FAULT adds none."""
    if value in (NO_FAULT, None):
        return raw
    if not isinstance(value, dict) or _FOR not in value:
        raise ValueError("expected a time and its length, as {at: 3, for: 1}, or none")
    entry = {("crash" if key == _FOR else key): each for key, each in value.items()}
    return {**raw, "timeline": [*(raw.get("timeline") or []), entry]}


def _end(name: str, raw: dict[str, Any]) -> dict[str, Any]:
    """Return the entry that clears a fault after its duration."""
    if "near" in raw:
        raise ValueError(f"{_FOR} does not go with near: the end time is unknown")
    at_s, duration_s = raw.get("at"), raw[_FOR]
    for key, time_s in (("at", at_s), (_FOR, duration_s)):
        if isinstance(time_s, bool) or not isinstance(time_s, int | float) or time_s < 0:
            text = f"at and {_FOR} must be numbers of seconds, 0 or more"
            raise ValueError(f"{text}; {key} is {quoted(time_s)}")
    return {"at": at_s + duration_s, "clear": name}


def _with_argument(raw: dict[str, Any], key: str, value: object) -> dict[str, Any]:
    """Return data with an argument, LABEL.ARGUMENT, of a command of the timeline replaced."""
    timeline = list(raw.get("timeline") or [])
    found = [(index, label) for index, label in labels(raw) if key.startswith(f"{label}.")]
    if not found:
        known = ", ".join(label for _, label in labels(raw)) or "none"
        raise ValueError(f"there is no command for {key!r}; LABEL.ARGUMENT, with LABEL of: {known}")
    index, label = max(found, key=lambda each: len(each[1]))
    command = timeline[index]["command"]
    name, arguments = next(iter(command.items())) if isinstance(command, dict) else (command, {})
    path = key.removeprefix(f"{label}.").split(".")
    timeline[index] = {
        **timeline[index],
        "command": {name: replaced(arguments, path, value)},
    }
    return {**raw, "timeline": timeline}


def labels(raw: dict[str, Any]) -> list[tuple[int, str]]:
    """Return index and label of each command in the plain data of a scenario."""
    found = []
    timeline = raw.get("timeline")
    for index, entry in enumerate(timeline if isinstance(timeline, list) else ()):
        command = entry.get("command") if isinstance(entry, dict) else None
        named = next(iter(command), None) if isinstance(command, dict) else command
        label = entry.get("label", named) if isinstance(entry, dict) else None
        if named is not None and isinstance(label, str):
            found.append((index, label))
    return found


def completions(begun: str) -> list[str]:
    """Return the arguments of `--set` with this prefix: keys, and values from lists of names."""
    return [text for text in _completions() if text.startswith(begun)]


def _completions() -> Iterator[str]:
    yield from ("seed=", "duration=", "inject=", "command.")
    yield from (f"asset={name}" for name in names_in(config_folder()))
    yield from (f"world={name}" for name in names_in(config_folder() / "worlds"))
    parts = {
        "world": World(),
        "odometry": SimulatedOdometry(),
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
