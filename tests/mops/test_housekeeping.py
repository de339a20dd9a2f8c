"""Housekeeping as a MOPS message, and what is none."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adapters.mops import (
    Housekeeping,
    MopsError,
    decode,
    encode,
    housekeeping_message,
    housekeeping_of,
    load_dictionary,
)

ENTRY = load_dictionary().spelling.housekeeping
NAMES = st.from_regex(r"[A-Z][A-Z0-9_]{0,39}", fullmatch=True)
FINITE = st.floats(allow_nan=False, allow_infinity=False)
REPORTED = housekeeping_message(Housekeeping(1.5, {"EXEC_TICK": 0.25}), ENTRY, "JACKAL")


@given(
    st.builds(
        Housekeeping,
        st.floats(0.0, 4e9),
        st.dictionaries(NAMES, st.none() | FINITE, max_size=30),
    )
)
def test_housekeeping_survives_the_round_trip(reported: Housekeeping) -> None:
    message = decode(encode(housekeeping_message(reported, ENTRY, "JACKAL")))
    assert housekeeping_of(message, ENTRY) == reported


@pytest.mark.parametrize(
    ("outputs", "why"),
    [
        ((), "utc_s: '' is no number"),
        (("nan",), "utc_s: 'nan' is not finite"),
        (("1e19",), "utc_s"),
        (("1.5", "EXEC_TICK"), "with a value each"),
        (("1.5", "exec_tick", "1.0"), "'exec_tick' is no name"),
        (("1.5", "EXEC_TICK", "1.0", "EXEC_TICK", "2.0"), "is there twice"),
        (("1.5", "EXEC_TICK", "fast"), "EXEC_TICK: 'fast' is no number"),
        (("1.5", "EXEC_TICK", "inf"), "EXEC_TICK: 'inf' is not finite"),
    ],
)
def test_what_does_not_fit_is_refused(outputs: tuple[str, ...], why: str) -> None:
    with pytest.raises(MopsError, match=why):
        housekeeping_of(replace(REPORTED, outputs=outputs), ENTRY)
    with pytest.raises(MopsError, match="is no housekeeping"):
        housekeeping_of(replace(REPORTED, command="LINK"), ENTRY)
