"""Facts of a navigation in any order, of any goal, with any values: no success is false."""

import tempfile
from math import inf, nan
from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st

from executive.commands import MoveTo, Waypoint
from executive.settings import NavigationGate
from executive.values.facts import (
    Fact,
    NavigationFeedback,
    NavigationState,
    NavigationStatus,
    NavigationVelocity,
    PlannedPath,
)
from executive.values.geometry import Point, Velocity
from tests.stress.navigated_drives import Watch, judge_success
from tests.support.examples import examples
from tests.support.kinematic import STEP_S
from tests.support.navigated import NavigatedBench

TARGET = Waypoint(1.2, 0.5, 0.4)
NUMBERS = st.integers(-1, 3)
VALUES = st.sampled_from((0.0, 0.02, -0.3, 0.3, 5.0, nan, inf, -inf))
FACTS = st.one_of(
    st.builds(NavigationStatus, NUMBERS, st.sampled_from(NavigationState), st.integers(0, 999)),
    st.builds(NavigationFeedback, NUMBERS, st.none() | VALUES, st.integers(-1, 5)),
    st.builds(NavigationVelocity, st.builds(Velocity, VALUES, VALUES)),
    st.builds(PlannedPath, NUMBERS, st.lists(st.builds(Point, VALUES, VALUES)).map(tuple)),
)
AT_ANY_TIME = st.lists(st.tuples(st.floats(0.0, 12.0), FACTS), max_size=12)


@given(at_any_time=AT_ANY_TIME, gate=st.sampled_from(NavigationGate))
@settings(max_examples=examples(16), deadline=None)
def test_facts_in_any_order_make_no_false_success(
    at_any_time: list[tuple[float, Fact]], gate: NavigationGate
) -> None:
    later = sorted(at_any_time, key=lambda each: each[0])
    with tempfile.TemporaryDirectory() as folder, NavigatedBench(Path(folder), gate) as bench:
        bench.run(1.0)
        bench.submit(MoveTo(TARGET), 1)
        watch = Watch(bench, 1, (TARGET,))
        for tick in range(round(14.0 / STEP_S)):
            while later and later[0][0] <= tick * STEP_S:
                bench.rover.facts.append(later.pop(0)[1])
            watch.step()
            if watch.ended:
                break
        result = watch.result()
        assert list(judge_success(result, str(result))) == []
