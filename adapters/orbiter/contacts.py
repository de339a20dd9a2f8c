"""What an operator says of the way to a rover, before the contact plan."""

from collections.abc import Callable
from typing import Final, assert_never

from adapters.bundle import (
    Aap2Settings,
    BundleError,
    ContactOverride,
    ContactPlan,
    DaemonSettings,
    Eid,
    EmbeddedAgent,
    IonSettings,
)
from adapters.orbiter.lines import CONTACT

BY_PLAN: Final = f"{CONTACT} PLAN"
"""What gives the way back to the plan, as it is typed."""


class Contacts:
    """Opens and closes the ways to the rovers. What is ordered holds until the process ends.

    Args:
        agent: sends the bundles.
        daemon: who carries them, if it is attached to somebody.
        read_plan: reads the contact plan again; raises BundleError.
    """

    def __init__(
        self,
        agent: EmbeddedAgent,
        daemon: DaemonSettings | None,
        read_plan: Callable[[], ContactPlan | None],
    ) -> None:
        """Go by the plan."""
        self._agent, self._daemon, self._read_plan = agent, daemon, read_plan

    def order(self, node: Eid, override: ContactOverride) -> str:
        """Do as the operator says; return what holds from now on.

        The plan is read again when the way is given back to it.

        Args:
            node: of the rover.
            override: what the operator says.

        Raises:
            BundleError: contacts are set elsewhere, or the plan cannot be read; all stays as it is.
        """
        if self._daemon is not None:
            raise BundleError(_elsewhere(self._daemon))
        if override is ContactOverride.BY_PLAN:
            plan = self._read_plan()
            self._agent.set_plan(plan)
        self._agent.override(node, override)
        match override:
            case ContactOverride.UP:
                return f"the way is held open by the operator until {BY_PLAN}"
            case ContactOverride.DOWN:
                return f"the way is held closed by the operator until {BY_PLAN}"
            case ContactOverride.BY_PLAN if plan is None:
                return "the way is open, for there is no plan"
            case ContactOverride.BY_PLAN:
                return "the way is as the plan says, which was read again"
            case _:
                assert_never(override)


def _elsewhere(daemon: DaemonSettings) -> str:
    match daemon:
        case IonSettings():
            return "ION carries the bundles: its contacts are set there, with ionadmin"
        case Aap2Settings():
            return "a uD3TN daemon carries the bundles: contacts are set there, with aap2-config"
        case _:
            assert_never(daemon)
