"""Two rovers behind one orbiter in the simulated world, and bundles by each convergence layer."""

from dataclasses import replace

import pytest

from executive.commands import MoveForward
from tests.simulated.convergence import Convergence
from tests.simulated.deeds import Deed, Kill, KillAtWrite, Link, Order, Storm
from tests.simulated.rovers import SECOND, check_apart
from tests.simulated.situations import CALM
from tests.simulated.storm import player

DEEDS: tuple[Deed, ...] = (
    Order(15.0, Link.RELAY, 1, MoveForward(0.2)),
    Order(15.0, Link.RELAY_2, 10_001, MoveForward(0.3)),
    KillAtWrite(15.5, "relay2", 2, after=True, down_s=1.0),
    Order(17.0, Link.DIRECT_2, 10_002, MoveForward(0.1)),
    Kill(18.0, "executive", 1.0),
    Kill(19.0, "orbiter", 1.0),
    Kill(20.0, "moe2", 1.0),
)


@pytest.mark.parametrize("layer", Convergence)
def test_commands_go_to_their_own_rover_over_kills(layer: Convergence) -> None:
    situation = replace(CALM, rovers=2, convergence=layer)
    with player(Storm("rovers", situation, DEEDS)) as playing:
        assert not playing.play().findings
        ends = playing.grounds["moe2"].journal.ends
        assert [identity.command_id for identity in ends] == [10_001]
        first, others = playing.addresses[0], playing.own[SECOND]
        assert list(check_apart(playing.world, first, others))  # as if they were for the other
