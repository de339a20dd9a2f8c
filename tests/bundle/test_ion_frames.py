"""The frames between the agent and its bridge to ION."""

from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adapters.bundle.codec.errors import DecodeError
from adapters.bundle.daemons.ion_frames import (
    Frame,
    FrameReader,
    Sent,
    decode_frame,
    encode_frame,
)

numbers = st.integers(0, 2**64 - 1)
values = {int: numbers, str: st.text(), bytes: st.binary(), bool: st.booleans()}
frames = st.one_of(
    *(
        st.builds(kind, *(values[field.type] for field in kind.__dataclass_fields__.values()))
        for kind in get_args(Frame)
    )
)


@given(st.lists(frames), st.data())
def test_a_stream_cut_anywhere_holds_the_frames_that_were_written(
    sent: list[Frame], data: st.DataObject
) -> None:
    octets = b"".join(map(encode_frame, sent))
    reader, got = FrameReader(), list[Frame]()
    while octets:
        cut = data.draw(st.integers(1, len(octets)))
        got += reader.feed(octets[:cut])
        octets = octets[cut:]
    assert got == sent


@given(st.binary())
def test_what_is_no_frame_is_refused(body: bytes) -> None:
    try:
        frame = decode_frame(body)
    except DecodeError:
        return
    assert encode_frame(frame)[4:] == body


def test_a_frame_ends_where_it_ends() -> None:
    body = encode_frame(Sent(7))[4:]
    for wrong in (body + b"\0", body[:-1], b"\x18\x63"):
        with pytest.raises(DecodeError):
            decode_frame(wrong)
