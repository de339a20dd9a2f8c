"""The product in situations that storms found, or find rarely."""

import pytest

from tests.simulated import situations
from tests.simulated.deeds import Storm
from tests.simulated.storm import play

REPEATED = (situations.END_UNRECORDED, situations.CONSOLE_POWER_LOST)
"""Over MOCUP, and over a console: played twice."""


@pytest.mark.parametrize("storm", situations.ALL.values(), ids=situations.ALL.keys())
def test_nothing_is_broken(storm: Storm) -> None:
    played = play(storm, quiet_s=situations.QUIET_S)
    assert not played.findings
    if storm in REPEATED:
        assert play(storm, quiet_s=situations.QUIET_S).digest == played.digest
