"""The charge of a battery: a ratio or per cent, empty or not measured."""

from math import nan
from pathlib import Path

import pytest
from sensor_msgs.msg import BatteryState

from adapters.ros.conversions import BatteryReader
from tests.ros.test_node import started

pytestmark = pytest.mark.ros


def charges(*sent: float, present: bool = True, voltage: float = 26.0) -> list[float | None]:
    message: list[str] = []
    reader = BatteryReader(message.append)
    states = (BatteryState(voltage=voltage, percentage=each, present=present) for each in sent)
    found = [reader.fact(state).charge_ratio for state in states]
    assert len(message) == reader.percent
    return found


@pytest.mark.parametrize(
    ("sent", "found"),
    [
        ((0.5, 1.0), [0.5, 1.0]),
        ((0.06, 0.02, 0.0), [0.06, 0.02, 0.0]),
        ((nan, -0.1), [None, None]),
        ((40.0, 1.0, 0.5, 0.0), [0.4, 0.01, 0.005, 0.0]),
        ((1.02, 0.98), [1.0, 0.98]),
        ((101.0, 0.5), [None, 0.5]),
        ((40.0, 101.0), [0.4, None]),
    ],
)
def test_a_charge_is_a_ratio_or_counts_to_100_for_good(
    sent: tuple[float, ...], found: list[float | None]
) -> None:
    assert charges(*sent) == found


def test_a_charge_of_zero_is_empty_unless_nothing_is_measured() -> None:
    assert charges(0.0) == [0.0], "it is there with a voltage"
    assert charges(0.0, present=False) == [None]
    assert charges(0.0, voltage=nan) == [None]
    assert charges(0.3, 0.0, present=False) == [0.3, 0.0]


def test_an_executive_that_learns_that_a_battery_counts_to_100_reports_it(
    ros_domain: int, tmp_path: Path
) -> None:
    assert ros_domain > 0
    with started(tmp_path, 0.05) as bench:
        battery = bench.publisher(BatteryState, bench.topics.battery)

        def known() -> bool:
            battery.publish(BatteryState(voltage=26.0, percentage=55.0, present=True))
            return bench.executive.status.battery is not None

        bench.until(known, "a battery")
        assert bench.executive.status.battery is not None
        assert bench.executive.status.battery.charge_ratio == 0.55
        text = "the battery reports its charge as 55: taken as percent"
        bench.until(lambda: text in [each.text for each in bench.executive.reports()], "a report")
