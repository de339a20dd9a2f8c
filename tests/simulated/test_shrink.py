"""Storms are reduced to the fewest deeds that still break a promise."""

from collections.abc import Callable

from tests.simulated.deeds import Kill, Storm
from tests.simulated.shrink import shrink
from tests.simulated.situations import CALM


def storm(count: int) -> Storm:
    return Storm("shrink", CALM, tuple(Kill(float(n), "relay", 1.0) for n in range(count)))


def times(storm: Storm) -> list[float]:
    return [deed.at_s for deed in storm.deeds]


def needing(*wanted: float) -> Callable[[Storm], bool]:
    return lambda storm: set(wanted) <= set(times(storm))


def test_one_deed_is_left_of_many() -> None:
    assert times(shrink(storm(100), needing(37.0))) == [37.0]


def test_deeds_that_need_each_other_stay_in_their_order() -> None:
    assert times(shrink(storm(64), needing(0.0, 31.0, 32.0, 63.0))) == [0.0, 31.0, 32.0, 63.0]


def test_nothing_is_left_where_the_situation_alone_breaks_it() -> None:
    assert not shrink(storm(20), lambda _: True).deeds


def test_all_stay_where_all_are_needed() -> None:
    assert shrink(storm(9), needing(*map(float, range(9)))) == storm(9)


def test_a_storm_without_deeds_stays() -> None:
    assert shrink(storm(0), lambda _: True) == storm(0)


def test_no_single_action_can_be_removed_from_the_rest() -> None:
    def breaks(storm: Storm) -> bool:
        return sum(1 for at_s in times(storm) if at_s % 3 == 0) >= 4

    assert len(shrink(storm(50), breaks).deeds) == 4


def test_its_result_still_breaks_the_promise_when_its_runs_are_used_up() -> None:
    played: list[Storm] = []

    def breaks(storm: Storm) -> bool:
        played.append(storm)
        return needing(1.0, 50.0, 98.0)(storm)

    minimal = shrink(storm(100), breaks, max_runs=7)
    assert len(played) == 7
    assert needing(1.0, 50.0, 98.0)(minimal)


def test_the_situation_and_the_seed_stay() -> None:
    minimal = shrink(storm(10), needing(4.0))
    assert (minimal.seed, minimal.situation) == ("shrink", CALM)
