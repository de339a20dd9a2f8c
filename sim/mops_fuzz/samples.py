"""Sound strings of every kind, to be spoilt."""

import types
from collections.abc import Callable, Sequence
from dataclasses import fields, is_dataclass
from random import Random
from typing import Any, Final, Union, get_args, get_origin, get_type_hints

from adapters.mops.dictionary import Dictionary
from adapters.mops.link_health import LinkHealth, health_message
from adapters.mops.message import Message, MopsError, encode
from adapters.mops.reports import event_of, refusal_of, reply_of
from adapters.mops.telemetry import telemetry_of
from executive.commands import Identity, Request
from executive.parameters import Parameter
from executive.reasons import Reason
from executive.reports import Kind, Report, Severity, Stage

SOURCE: Final = "MOE"
TEXTS: Final = ("", "near", "a, b|c#d %", "pictures/1.jpg", "VIDEO ON", "BTCPP4", "é…")
NUMBERS: Final = (0.0, -1.5, 0.25, 3.0, 1e-3, 1e300)
MANY: Final = 2000
NEW: Final = 0.05
"""Part of the messages that never came before."""
Some = Callable[[], Message]


class Samples:
    """Makes sound messages of an asset, by a seed."""

    def __init__(self, dictionary: Dictionary, random: Random, asset: str) -> None:
        """Make of this dictionary."""
        self._dictionary, self._random, self._asset = dictionary, random, asset
        self._many: list[bytes] = []
        self._kinds = [kind for kind in get_args(Request) if self._is_spelled(kind)]
        self._makers: Sequence[Some] = (
            self.command, self.command, self._reply, self._refusal, self._event,
            self._telemetry, self._health,
        )  # fmt: skip

    def octets(self) -> bytes:
        """Return any message, one of many that are made anew now and then."""
        if len(self._many) < MANY:
            self._many.append(self._new())
            return self._many[-1]
        at = self._random.randrange(MANY)
        if self._random.random() < NEW:
            self._many[at] = self._new()
        return self._many[at]

    def _new(self) -> bytes:
        """Return one that can be written; some values make it too long or empty."""
        while True:
            try:
                return encode(self._random.choice(self._makers)())
            except MopsError:
                continue

    def command(self) -> Message:
        """Return a command, which may make no sense beyond its form."""
        request = _made(self._random.choice(self._kinds), self._random)
        return self._dictionary.command(request, self._identity(), self._asset)

    def _is_spelled(self, kind: type) -> bool:
        try:
            self._dictionary.command(_made(kind, Random(1)), Identity(SOURCE, 1), self._asset)
        except MopsError:
            return False
        return True

    def _identity(self) -> Identity:
        return Identity(SOURCE, self._random.randrange(1, 1 << self._random.randrange(1, 40)))

    def _report(self, kind: Kind) -> Report:
        random, of_command = self._random, kind is Kind.COMMAND
        stage = random.choice(list(Stage))
        return Report(
            random.randrange(1, 1 << 20),
            random.uniform(0.0, 2e9),
            kind,
            random.choice(list(Severity)),
            random.choice(TEXTS),
            self._identity() if of_command else None,
            stage if of_command else None,
            "relay" if of_command else None,
            reason=random.choice((None, *Reason)),
        )

    def _reply(self) -> Message:
        entry = self._dictionary.entry(self.command())
        return reply_of(self._report(Kind.COMMAND), entry, self._asset)

    def _refusal(self) -> Message:
        return refusal_of(self.command(), self._asset, self._random.choice(TEXTS))

    def _event(self) -> Message:
        event = self._report(Kind.EVENT)
        return event_of(event, self._dictionary.spelling.event, self._asset)

    def _telemetry(self) -> Message:
        known = {each: self._random.choice((None, *NUMBERS)) for each in Parameter}
        return telemetry_of(known, self._dictionary.spelling.telemetry, self._asset, "ALL")

    def _health(self) -> Message:
        health = LinkHealth(self._random.uniform(0.0, 2e9), 3, 1.5, None, 0.25, 0, 0)
        return health_message(health, self._dictionary.spelling.link, self._asset)


def _made(kind: type, random: Random) -> Any:
    """Return a dataclass with any values."""
    hints = get_type_hints(kind)
    return kind(**{field.name: _value(hints[field.name], random) for field in fields(kind)})


def _value(hint: Any, random: Random) -> Any:
    if get_origin(hint) is tuple:
        return tuple(_value(get_args(hint)[0], random) for _ in range(random.randrange(3)))
    if get_origin(hint) in (Union, types.UnionType):
        return _value(random.choice(get_args(hint)), random)
    if is_dataclass(hint) and isinstance(hint, type):
        return _made(hint, random)
    if hint is type(None):
        return None
    if hint is bytes:
        return random.randbytes(random.randrange(9))
    return random.choice({float: NUMBERS, int: (0, 1, 80, -7, 1 << 40), str: TEXTS}[hint])
