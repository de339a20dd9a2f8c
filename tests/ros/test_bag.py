"""A bag of a recording: what no bag can hold is said of the recording."""

from math import inf, nan
from pathlib import Path
from typing import Any, cast

import pytest

from adapters.recording import RecordingError
from adapters.ros.bag import BagMessage, _merged
from adapters.ros.conversions import time_message


class OneMessage:
    """Converts to one message at a time."""

    def __init__(self, utc_s: float) -> None:
        self.stamped = BagMessage(utc_s, "/odom", "nav_msgs/msg/Odometry", b"")

    def items(self, _: object) -> list[BagMessage]:
        return [self.stamped]

    def trees(self, _: object) -> list[BagMessage]:
        return []


@pytest.mark.parametrize("utc_s", [-1.0, nan, inf, 1e10])
def test_a_time_that_a_bag_cannot_hold_is_an_error_of_the_recording(utc_s: float) -> None:
    converter = cast(Any, OneMessage(utc_s))
    with pytest.raises(RecordingError, match="has a value that no ROS message can hold"):
        list(_merged(converter, Path("run.mcap"), cast(Any, None)))


@pytest.mark.parametrize("time_s", [-(2.0**31) - 1.0, 2.0**31, nan, inf])
def test_a_time_that_no_stamp_holds_is_not_written_as_another(time_s: float) -> None:
    with pytest.raises((OverflowError, ValueError)):
        time_message(time_s)
