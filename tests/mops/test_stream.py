from hypothesis import given
from hypothesis import strategies as st

from adapters.mops import Message, MopsStream, encode
from adapters.mops.codec import LONGEST
from tests.mops.test_message import MESSAGES, MOVE, TEXT

GARBAGE = st.binary(min_size=1, max_size=100).map(lambda octets: octets.replace(b"#", b"?") + b"#")


class Told:
    def __init__(self) -> None:
        self.lines: list[str] = []
        self.stream = MopsStream(self.lines.append)

    def feed(self, *pieces: bytes) -> list[Message]:
        return [message for piece in pieces for message in self.stream.feed(piece)]


@given(st.lists(st.one_of(MESSAGES.map(encode), GARBAGE)), st.data())
def test_messages_come_whatever_lies_between_and_wherever_it_is_cut(
    pieces: list[bytes], data: st.DataObject
) -> None:
    octets, told = b"".join(pieces), Told()
    cuts = sorted(data.draw(st.lists(st.integers(0, len(octets)), max_size=8)))
    parts = [octets[a:b] for a, b in zip([0, *cuts], [*cuts, len(octets)], strict=True)]
    whole = Told()
    assert told.feed(*parts) == whole.feed(octets)
    assert told.lines == whole.lines
    messages = [piece for piece in pieces if Told().feed(piece)]
    assert whole.stream.dropped_octets == len(octets) - sum(map(len, messages))
    assert whole.stream.dropped_pieces == len(pieces) - len(messages) == len(whole.lines)


def test_padding_is_not_worth_a_word() -> None:
    told = Told()
    assert told.feed(b"\0" * 22 + TEXT + b"\r\n" + TEXT + b"\0\0") == [MOVE, MOVE]
    assert told.lines == []


def test_what_was_dropped_is_told_once_with_why() -> None:
    told = Told()
    assert told.feed(b"half|a mess" + TEXT + TEXT) == [MOVE]
    (line,) = told.lines
    assert "half|a mess" in line
    assert "fields" in line
    assert told.stream.dropped_octets == len(b"half|a mess" + TEXT)


def test_what_never_ends_is_not_kept() -> None:
    told = Told()
    for _ in range(100):
        assert told.feed(b"x" * (LONGEST - 1)) == []
        assert len(told.stream._begun) < LONGEST
    assert told.feed(b"x#" + TEXT) == [MOVE]
    (line,) = told.lines
    assert line.startswith(f"{100 * (LONGEST - 1) + 2} octets")
