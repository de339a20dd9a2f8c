"""Sound strings of every kind, to be spoilt."""

import types
from collections.abc import Callable, Sequence
from dataclasses import fields, is_dataclass
from random import Random
from typing import Any, Final, Union, get_args, get_origin, get_type_hints

from adapters.mops import (
    Dictionary,
    LinkHealth,
    Message,
    MopsError,
    encode,
    event_of,
    health_message,
    refusal_of,
    reply_of,
    telemetry_of,
)
from executive.commands import Request
from executive.reasons import Reason
from executive.reports import Identity, Kind, Report, Severity, Stage
from executive.state import Parameter
from tests.stress.mops_grammar import FIELDS, LONGEST
from tests.stress.mutation import mutate

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


MOST_TOGETHER: Final = 4
SPOILT: Final = 0.85
"""Part of the messages that something is done to."""
WORDS: Final = (
    *(b"", b" ", b"\0", b"\n", b",", b",,", b"#", b"|", b"%", b"%ZZ", b"%ff", b"%2c", b"\xff"),
    *("٣".encode(), "…".encode(), b"nan", b"inf", b"-inf", b"1e999", b"-0", b"+1", b"1_0", b"0x1"),
    *(
        b"9" * 10,
        b"9" * 19,
        b"9" * 30,
        b"9" * 50,
        b"-1",
        b"-1e300",
        b"1e300",
        b"007",
        b"true",
        b"TRUE",
        b"True",
        b"False",
        b"None",
        b"0",
    ),
    *(b"101", b"10e", b"FFF", b"1000", b"10E", b"301", b"201", b"302", b"STOP", b"MOVE_FORWARD"),
    *(b"MOE", b"JACKAL", b"MOCUP", b"ALL", b"jackal", b"EXECUTED", b"REJECTED", b"PROGRESS"),
    *(b"A" * 300, b"A" * (LONGEST + 200), b"1.0," * 500, b"1.0," * 1500),
)
_NEAR: Final[Sequence[Callable[[bytes], bytes]]] = (
    lambda field: field.lower(),
    lambda field: field.upper(),
    lambda field: b"0" + field,
    lambda field: b"+" + field,
    lambda field: field + b" ",
    lambda field: field[:-1],
    lambda field: field[:1].lower() + field[1:],
)
"""What somebody who writes strings by hand might take for the same."""
_EDGES: Final = (LONGEST - 1, LONGEST, LONGEST + 1)


class Wrong:
    """Makes strings, by a seed.

    Attributes:
        mutated: how many messages had something done to them; a few are sound all the same.
    """

    def __init__(self, samples: Samples, random: Random) -> None:
        """Spoil these samples."""
        self._samples, self._random = samples, random
        self.mutated = 0
        self._ways: Sequence[Callable[[bytes], bytes]] = (
            self._octets, self._octets, self._field, self._field, self._field, self._value,
            self._near, self._shuffled, self._counted, self._between, self._long,
        )  # fmt: skip

    def octets(self) -> bytes:
        """Return one message or several, most of them spoilt, and a sound one behind them."""
        count = self._random.randrange(1, MOST_TOGETHER)
        return b"".join(self._one() for _ in range(count)) + self._end() + self._samples.octets()

    def cuts(self, octets: bytes) -> list[bytes]:
        """Return octets in portions."""
        where = sorted(self._random.randrange(len(octets) + 1) for _ in range(2))
        return [octets[: where[0]], octets[where[0] : where[1]], octets[where[1] :]]

    def _one(self) -> bytes:
        sound = self._samples.octets()
        if self._random.random() >= SPOILT:
            return sound
        self.mutated += 1
        return self._random.choice(self._ways)(sound)

    def _end(self) -> bytes:
        """Return what ends a piece that may have lost its own end."""
        return self._random.choice((b"", b"#", b"\r\n#", b"\n"))

    def _octets(self, sound: bytes) -> bytes:
        return mutate(sound, self._random, self._part)

    def _part(self, octets: bytearray, at: int) -> None:
        octets[at:at] = self._random.choice((b"#", b"|", b",", b"\n", b"\0", b"%"))

    def _field(self, sound: bytes) -> bytes:
        fields = sound[:-1].split(b"|")
        fields[self._random.randrange(len(fields))] = self._random.choice(WORDS)
        return b"|".join(fields) + b"#"

    def _near(self, sound: bytes) -> bytes:
        fields = sound[:-1].split(b"|")
        at = self._random.randrange(FIELDS)
        fields[at] = self._random.choice(_NEAR)(fields[at])
        return b"|".join(fields) + b"#"

    def _value(self, sound: bytes) -> bytes:
        """Spoil one value among those of a field."""
        fields = sound[:-1].split(b"|")
        which = self._random.choice((4, 5))
        values = fields[which].split(b",")
        values[self._random.randrange(len(values))] = self._random.choice(WORDS)
        fields[which] = b",".join(values)
        return b"|".join(fields) + b"#"

    def _shuffled(self, sound: bytes) -> bytes:
        fields = sound[:-1].split(b"|")
        one, other = self._random.randrange(FIELDS), self._random.randrange(FIELDS)
        fields[one], fields[other] = fields[other], fields[one]
        return b"|".join(fields) + b"#"

    def _counted(self, sound: bytes) -> bytes:
        fields = sound[:-1].split(b"|")
        at = self._random.randrange(FIELDS)
        if self._random.random() < 0.5:
            del fields[at]
        else:
            fields.insert(at, self._random.choice(WORDS))
        return b"|".join(fields) + b"#"

    def _between(self, sound: bytes) -> bytes:
        junk = self._random.choice((b"\0\0", b"\r\n", b" ", b"garbage", b"#", b"##", b"\xff\xfe#"))
        return junk + sound if self._random.random() < 0.5 else sound[:-1] + junk

    def _long(self, sound: bytes) -> bytes:
        """Fill the outputs up to the longest message, or one octet more or less."""
        fields = sound[:-1].split(b"|")
        spare = self._random.choice(_EDGES) - len(sound)
        fields[5] += b"A" * max(0, spare)
        return b"|".join(fields) + b"#"
