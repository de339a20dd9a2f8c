"""The product in situations that storms found, or find rarely."""

import pytest

from tests.simulated import situations
from tests.simulated.deeds import Storm
from tests.simulated.storm import play


@pytest.mark.parametrize("storm", situations.ALL.values(), ids=situations.ALL.keys())
def test_nothing_is_broken(storm: Storm) -> None:
    assert not play(storm, quiet_s=situations.QUIET_S).findings
