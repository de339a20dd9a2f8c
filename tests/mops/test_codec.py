"""tests.mops.test_codec"""

import string
from base64 import b64encode
from zlib import compress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adapters.mops import Message, MopsError, MopsStream, decode, encode
from adapters.mops.codec import (
    MAX_COUNTER,
    MAX_ID,
    MAX_INFLATED_OCTETS,
    MAX_MESSAGE_OCTETS,
    MAX_PLAIN_OCTETS,
    from_values,
    values_of,
)
from executive.commands import PlanDefinition

RETAINED = "".join(sorted(set(string.printable[:95]) - set("|,#")))
NAMES = st.text(RETAINED.replace(" ", ""), min_size=1, max_size=20)
VALUES = (
    st.lists(st.text(RETAINED, max_size=12), max_size=6).map(tuple).filter(lambda v: v != ("",))
)
MESSAGES = st.builds(
    Message,
    st.integers(0, 0xFFF),
    NAMES,
    NAMES,
    NAMES,
    VALUES,
    VALUES,
    st.booleans(),
    st.booleans(),
    st.none() | st.integers(0, MAX_ID),
    st.none() | st.integers(0, MAX_COUNTER),
)
MOVE = Message(0x102, "MOE", "MOCUP", "MOVE", ("1.500",), (), False, False, 7, 1)
TEXT = b"102|MOE|MOCUP|MOVE|1.500||False|False|7|1#"


def test_a_message_is_written_as_in_the_thesis() -> None:
    assert encode(MOVE) == TEXT
    assert str(MOVE) == TEXT.decode()
    assert decode(TEXT) == MOVE
    telemetry = Message(0x301, "MOCUP", "MOE", "TM", (), ("1.0", "", "2"), True)
    assert encode(telemetry) == b"301|MOCUP|MOE|TM||1.0,,2|True|False||#"


@given(MESSAGES)
def test_every_message_survives_the_round_trip(message: Message) -> None:
    assert decode(encode(message)) == message


@given(st.binary(max_size=200))
def test_messages_are_written_as_they_were_read(octets: bytes) -> None:
    try:
        message = decode(octets)
    except MopsError:
        return
    assert encode(message) == octets


@given(MESSAGES, st.data())
def test_a_changed_message_is_another_or_none(message: Message, data: st.DataObject) -> None:
    octets = bytearray(encode(message))
    at = data.draw(st.integers(0, len(octets) - 1))
    octets[at] ^= data.draw(st.integers(1, 255))
    try:
        changed = decode(bytes(octets))
    except MopsError:
        return
    assert changed != message
    assert encode(changed) == octets


@pytest.mark.parametrize(
    ("octets", "field"),
    [
        (b"", "no #"),
        (TEXT[:-1], "no #"),
        (b"102|MOE|MOCUP|MOVE|1.500||False|False|7#", "9 fields"),
        (TEXT.replace(b"7|", b"7||"), "11 fields"),
        (TEXT.replace(b"102", b"0102"), "code"),
        (TEXT.replace(b"102", b"1g2"), "code"),
        (TEXT.replace(b"102", b"10a"), "code"),
        (TEXT.replace(b"MOE", b""), "source"),
        (TEXT.replace(b"MOCUP", b"MO CUP"), "dest"),
        (TEXT.replace(b"MOVE", b"M\xc3\xb6VE"), "command"),
        (TEXT.replace(b"MOVE", b"MOVE,2"), "command"),
        (TEXT.replace(b"1.500", b"1\n500"), "inputs"),
        (TEXT.replace(b"False|False", b"False|false"), "executed"),
        (TEXT.replace(b"False|False", b"1|False"), "received"),
        (TEXT.replace(b"7|1", b"07|1"), "moeinputsid"),
        (TEXT.replace(b"7|1", b"-7|1"), "moeinputsid"),
        (TEXT.replace(b"7|1", b"9223372036854775808|1"), "moeinputsid"),
        (TEXT.replace(b"7|1", b"123456789012345\n67890|1"), "moeinputsid"),
        (TEXT.replace(b"7|1", b"7|4294967296"), "moeinputscounter"),
        (TEXT.replace(b"7|1", b"7|" + b"9" * 5000), "octets"),
    ],
)
def test_an_error_is_named(octets: bytes, field: str) -> None:
    with pytest.raises(MopsError, match=field) as refused:
        decode(octets)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    "message",
    [
        Message(0x1000, "a", "b", "c"),
        Message(-1, "a", "b", "c"),
        Message(1, "", "b", "c"),
        Message(1, "a|", "b", "c"),
        Message(1, "a", "b", "c", ("1,2",)),
        Message(1, "a", "b", "c", ("#",)),
        Message(1, "a", "b", "c", ("",)),
        Message(1, "a", "b", "c", (), ("\0",)),
        Message(1, "a", "b", "c", moe_inputs_id=-1),
        Message(1, "a", "b", "c", moe_inputs_counter=MAX_COUNTER + 1),
        Message(1, "a", "b", "c", ("x" * MAX_MESSAGE_OCTETS,)),
    ],
)
def test_what_cannot_be_written_is_refused(message: Message) -> None:
    with pytest.raises(MopsError):
        encode(message)


GARBAGE = st.binary(min_size=1, max_size=100).map(lambda octets: octets.replace(b"#", b"?") + b"#")


class Collected:
    def __init__(self) -> None:
        self.lines: list[str] = []
        self.stream = MopsStream(self.lines.append)

    def feed(self, *pieces: bytes) -> list[Message]:
        return [message for piece in pieces for message in self.stream.feed(piece)]


@given(st.lists(st.one_of(MESSAGES.map(encode), GARBAGE)), st.data())
def test_messages_are_found_among_any_octets_and_for_any_fragmentation(
    pieces: list[bytes], data: st.DataObject
) -> None:
    octets, collected = b"".join(pieces), Collected()
    cuts = sorted(data.draw(st.lists(st.integers(0, len(octets)), max_size=8)))
    parts = [octets[a:b] for a, b in zip([0, *cuts], [*cuts, len(octets)], strict=True)]
    whole = Collected()
    assert collected.feed(*parts) == whole.feed(octets)
    assert collected.lines == whole.lines
    messages = [piece for piece in pieces if Collected().feed(piece)]
    assert whole.stream.dropped_octets == len(octets) - sum(map(len, messages))
    assert whole.stream.dropped_pieces == len(pieces) - len(messages) == len(whole.lines)


def test_padding_is_not_worth_a_word() -> None:
    collected = Collected()
    assert collected.feed(b"\0" * 22 + TEXT + b"\r\n" + TEXT + b"\0\0") == [MOVE, MOVE]
    assert collected.lines == []


def test_dropped_octets_are_reported_once_with_the_reason() -> None:
    collected = Collected()
    assert collected.feed(b"half|a mess" + TEXT + TEXT) == [MOVE]
    (line,) = collected.lines
    assert "half|a mess" in line
    assert "fields" in line
    assert collected.stream.dropped_octets == len(b"half|a mess" + TEXT)


def test_an_unterminated_message_is_not_retained() -> None:
    collected = Collected()
    for _ in range(100):
        assert collected.feed(b"x" * (MAX_MESSAGE_OCTETS - 1)) == []
        assert len(collected.stream._begun) < MAX_MESSAGE_OCTETS
    assert collected.feed(b"x#" + TEXT) == [MOVE]
    (line,) = collected.lines
    assert line.startswith(f"{100 * (MAX_MESSAGE_OCTETS - 1) + 2} octets")


LONG_PLAN = b"".join(
    b'<moveTo name="%d" x="%d" y="0" deadline_s="60"/>' % (n, n) for n in range(99)
)


def test_a_long_plan_fits_a_message() -> None:
    assert len(LONG_PLAN) > MAX_MESSAGE_OCTETS
    definition = PlanDefinition("day", "day", "BTCPP4", LONG_PLAN)
    (plan_id, name, kind, octets) = values_of(definition)
    assert len(octets) < MAX_PLAIN_OCTETS
    assert from_values(PlanDefinition, (plan_id, name, kind, octets)) == definition


def deflated(octets: bytes) -> str:
    return "~" + b64encode(compress(octets, 9, wbits=-15)).decode()


@pytest.mark.parametrize(
    ("value", "why"),
    [
        ("~" + b64encode(b"no deflate").decode(), "damaged"),
        (deflated(LONG_PLAN)[:-8], "not one stream"),
        (deflated(b"0" * (MAX_INFLATED_OCTETS + 1)), "not one stream"),
        (deflated(b"short"), "not one stream"),
        ("~~", "no base64"),
    ],
)
def test_compressed_octets_are_refused(value: str, why: str) -> None:
    with pytest.raises(MopsError, match=f"content: .*{why}"):
        from_values(PlanDefinition, ("day", "day", "BTCPP4", value))
