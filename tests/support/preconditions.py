"""Preconditions of all kinds, for property tests."""

from math import pi

from hypothesis import strategies as st

from executive.commands import Mode, OnlyAt, Precondition

_numbers = st.floats(-1e9, 1e9)
_bounds = st.builds(
    OnlyAt,
    _numbers,
    _numbers,
    st.floats(1e-6, 1e6),
) | st.builds(
    OnlyAt, _numbers, _numbers, st.floats(1e-6, 1e6), st.floats(-10, 10), st.floats(1e-6, pi)
)
PRECONDITIONS = st.builds(
    Precondition,
    st.none() | _bounds,
    st.none() | st.integers(1, (1 << 63) - 1),
    st.none() | st.sampled_from(Mode),
)
