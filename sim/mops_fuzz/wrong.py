"""What can be wrong with a string: octets, fields, values, lengths, what is between messages."""

from collections.abc import Callable, Sequence
from random import Random
from typing import Final

from sim.fuzz.spoiling import spoilt
from sim.mops_fuzz.grammar import FIELDS, LONGEST
from sim.mops_fuzz.samples import Samples

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
        return spoilt(sound, self._random, self._part)

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
