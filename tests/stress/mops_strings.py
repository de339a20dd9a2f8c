"""MOPS strings of every kind that the dictionary spells, and what can be wrong with them."""

from collections.abc import Callable, Sequence
from functools import cache
from random import Random
from typing import Final, get_args

from hypothesis import strategies as st

from adapters.mops import (
    Housekeeping,
    LinkHealth,
    Message,
    MopsError,
    encode,
    event_of,
    health_message,
    housekeeping_message,
    load_dictionary,
    refusal_of,
    reply_of,
    telemetry_of,
)
from executive.commands.catalogue import Request
from executive.values.parameters import Parameter
from executive.values.reasons import Reason
from executive.values.reports import Identity, Report, ReportKind, Stage
from tests.stress.fuzzing import examples, fragments, mutate
from tests.stress.mops_grammar import FIELDS, MAX_OCTETS

EACH: Final = 20
"""Sound messages of each kind, of which the wrong ones are made."""
TEXTS: Final = st.sampled_from(
    ("", "near", "a, b|c#d %", "pictures/1.jpg", "VIDEO ON", "BTCPP4", "é…")
)
NUMBERS: Final = st.sampled_from((0.0, -1.5, 0.25, 3.0, 1e-3, 1e300)) | st.floats()
IDENTITIES: Final = st.builds(Identity, st.just("MOE"), st.integers(1, 1 << 40))
REASONS: Final = st.none() | st.sampled_from(Reason)
KNOWN: Final = st.fixed_dictionaries({each: st.none() | NUMBERS for each in Parameter})
MAX_TOGETHER: Final = 4
MUTATED: Final = 0.85
"""Part of the messages that something is done to."""
SIZES: Final = (10, 100, 1000)
TOKENS: Final = (
    *(b"", b" ", b"\0", b"\n", b",", b",,", b"#", b"|", b"%", b"%ZZ", b"%ff", b"%2c", b"\xff"),
    *("٣".encode(), "…".encode(), b"nan", b"inf", b"-inf", b"1e999", b"-0", b"+1", b"1_0", b"0x1"),
    *(b"9" * 10, b"9" * 19, b"9" * 30, b"9" * 50, b"-1", b"-1e300", b"1e300", b"007", b"0"),
    *(b"true", b"TRUE", b"True", b"False", b"None", b"101", b"10e", b"FFF", b"1000", b"10E"),
    *(b"301", b"201", b"302", b"STOP", b"MOVE_FORWARD", b"EXECUTED", b"REJECTED", b"PROGRESS"),
    *(b"MOE", b"JACKAL", b"MOCUP", b"ALL", b"jackal"),
    *(b"A" * 300, b"A" * (MAX_OCTETS + 200), b"1.0," * 500, b"1.0," * 1500),
)
_SPLICES: Final = (b"#", b"|", b",", b"\n", b"\0", b"%")
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
_EDGES: Final = (MAX_OCTETS - 1, MAX_OCTETS, MAX_OCTETS + 1)


@cache
def sound_messages(asset: str, seed: int) -> tuple[bytes, ...]:
    """Return messages of an asset; commands may make no sense beyond their form."""
    dictionary = load_dictionary()
    spelling = dictionary.spelling

    def reports(kind: ReportKind) -> st.SearchStrategy[Report]:
        of_command = {
            "identity": IDENTITIES, "stage": st.sampled_from(Stage), "link": st.just("relay"),
        }  # fmt: skip
        return st.builds(
            Report,
            sequence=st.integers(1, 1 << 20),
            utc_s=st.floats(0.0, 2e9),
            kind=st.just(kind),
            text=TEXTS,
            reason=REASONS,
            **(of_command if kind is ReportKind.COMMAND else {}),
        )

    def command(request: Request, identity: Identity) -> Message | None:
        try:
            return dictionary.command(request, identity, asset)
        except MopsError:
            return None  # MOPS has no words for it

    def reply(report: Report, message: Message | None) -> Message | None:
        return message and reply_of(report, dictionary.entry(message), asset)

    def refusal(message: Message | None, text: str) -> Message | None:
        return message and refusal_of(message, asset, text)

    def health(utc_s: float) -> Message:
        return health_message(LinkHealth(utc_s, 3, 1.5, None, 0.25, 0, 0), spelling.link, asset)

    def housekeeping(utc_s: float) -> Message:
        reported = Housekeeping(utc_s, {"EXEC_TICK": 0.25, "EXEC_GOALS": None})
        return housekeeping_message(reported, spelling.housekeeping, asset)

    commands = [st.builds(command, st.from_type(kind), IDENTITIES) for kind in get_args(Request)]
    any_command = st.one_of(commands)
    kinds: list[st.SearchStrategy[Message | None]] = [
        *commands,
        st.builds(reply, reports(ReportKind.COMMAND), any_command),
        st.builds(refusal, any_command, TEXTS),
        reports(ReportKind.EVENT).map(lambda report: event_of(report, spelling.event, asset)),
        KNOWN.map(lambda known: telemetry_of(known, spelling.telemetry, asset, "ALL")),
        st.floats(0.0, 2e9).map(health),
        st.floats(0.0, 2e9).map(housekeeping),
    ]
    found = (each for kind in kinds for each in examples(kind, EACH, seed) if each is not None)
    return tuple(octets for message in found for octets in _encoded(message))


def _encoded(message: Message) -> list[bytes]:
    """Return a message as octets, unless some value makes it too long or empty."""
    try:
        return [encode(message)]
    except MopsError:
        return []


class Wrong:
    """Makes texts of an asset in which something is wrong, by a seed.

    Attributes:
        mutated: how many messages had something done to them; a few are sound all the same.
    """

    def __init__(self, asset: str, seed: int) -> None:
        self._sound = sound_messages(asset, seed)
        self._random = Random(seed)
        self.mutated = 0
        self._mutations: Sequence[Callable[[bytes], bytes]] = (
            *[self._octets] * 2, self._between, *[self._of_fields] * 8,
        )  # fmt: skip
        self._changes: Sequence[Callable[[list[bytes]], None]] = (
            *[self._field] * 3, self._value, self._near, self._swapped, self._counted, self._long,
        )  # fmt: skip

    def portions(self) -> list[bytes]:
        """Return one message or several, most of them wrong, and a sound one behind them."""
        messages = [self._one() for _ in range(self._random.randrange(1, MAX_TOGETHER))]
        # What follows a piece that may have lost its own end must be found all the same.
        end = self._random.choice((b"", b"#", b"\r\n#", b"\n"))
        text = b"".join((*messages, end, self._random.choice(self._sound)))
        return fragments(text, self._random, SIZES)

    def _one(self) -> bytes:
        sound = self._random.choice(self._sound)
        if self._random.random() >= MUTATED:
            return sound
        self.mutated += 1
        return self._random.choice(self._mutations)(sound)

    def _octets(self, sound: bytes) -> bytes:
        return mutate(sound, self._random, _SPLICES)

    def _between(self, sound: bytes) -> bytes:
        junk = self._random.choice((b"\0\0", b"\r\n", b" ", b"garbage", b"#", b"##", b"\xff\xfe#"))
        return junk + sound if self._random.random() < 0.5 else sound[:-1] + junk

    def _of_fields(self, sound: bytes) -> bytes:
        fields = sound[:-1].split(b"|")
        self._random.choice(self._changes)(fields)
        return b"|".join(fields) + b"#"

    def _field(self, fields: list[bytes]) -> None:
        fields[self._random.randrange(FIELDS)] = self._random.choice(TOKENS)

    def _near(self, fields: list[bytes]) -> None:
        at = self._random.randrange(FIELDS)
        fields[at] = self._random.choice(_NEAR)(fields[at])

    def _value(self, fields: list[bytes]) -> None:
        which = self._random.choice((4, 5))
        values = fields[which].split(b",")
        values[self._random.randrange(len(values))] = self._random.choice(TOKENS)
        fields[which] = b",".join(values)

    def _swapped(self, fields: list[bytes]) -> None:
        one, other = self._random.randrange(FIELDS), self._random.randrange(FIELDS)
        fields[one], fields[other] = fields[other], fields[one]

    def _counted(self, fields: list[bytes]) -> None:
        at = self._random.randrange(FIELDS)
        if self._random.random() < 0.5:
            del fields[at]
        else:
            fields.insert(at, self._random.choice(TOKENS))

    def _long(self, fields: list[bytes]) -> None:
        """Fill the outputs up to the longest message, or one octet more or less."""
        octets = sum(map(len, fields)) + len(fields)
        fields[5] += b"A" * max(0, self._random.choice(_EDGES) - octets)
