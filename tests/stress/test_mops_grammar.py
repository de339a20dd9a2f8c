"""The second grammar against the first: what one of them writes, the other takes."""

import pytest

from tests.stress.mops_grammar import Stream, cut, is_sound

SOUND = b"102|MOE|MOCUP|MOVE|1.500||False|False|7|1#"


def test_what_the_thesis_writes_is_sound() -> None:
    assert is_sound(SOUND)
    assert is_sound(b"102|MOE|MOCUP|MOVE|||False|False||#")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"102", b"10e"),
        (b"102", b"1102"),
        (b"MOE", b""),
        (b"MOE", b"M E"),
        (b"MOVE", b"MO,VE"),
        (b"1.500", b"\xe9"),
        (b"1.500", b"\n"),
        (b"1.500", b"1" * 4096),
        (b"False", b"false"),
        (b"|7|", b"|07|"),
        (b"|7|", b"|-7|"),
        (b"|7|", b"|9223372036854775808|"),
        (b"|1#", b"|4294967296#"),
        (b"|1#", b"#"),
        (b"#", b""),
    ],
)
def test_what_differs_is_not(old: bytes, new: bytes) -> None:
    assert not is_sound(SOUND.replace(old, new, 1))


def test_a_text_is_cut_whole_and_a_stream_in_portions() -> None:
    text = b"\0\r\n" + SOUND + b"FLY#" + SOUND + b"half"
    found = cut(text)
    assert (found.sound, found.wrong) == ([SOUND, SOUND], 2)
    stream = Stream()
    portions = [text[at : at + 7] for at in range(0, len(text), 7)]
    cuts = [stream.cut(portion) for portion in portions]
    assert [each for one in cuts for each in one.sound] == [SOUND, SOUND]
    assert sum(one.wrong for one in cuts) == 1
