"""What is asked about, and what has to be said."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from executive.goals import Context
from executive.plans import Tree
from executive.settings import Settings, load_settings
from executive.values.reasons import Reason
from tests.support.kinematic import Bench, KinematicRover
from trees import RoverTree

JACKAL: Final = load_settings("jackal")


@dataclass(frozen=True, slots=True)
class Case:
    """One cause, and what has to be named.

    Attributes:
        name: for people.
        inject: brings the situation about.
        command: what is asked about; None for why the rover stands or moves.
        reason: what must be named; None where no number stands for the cause.
        output: words that must stand in the explanation.
        settings: of the asset.
        ends: whether the executive has ended; who is asked live is the one after it.
        rover: makes the rover; a kinematic one unless given.
        build_tree: makes the tree.
    """

    name: str
    inject: Callable[[Bench], object]
    command: str | None
    reason: Reason | None
    output: str = ""
    settings: Settings = JACKAL
    ends: bool = False
    rover: Callable[[Settings], KinematicRover] | None = None
    build_tree: Callable[[Context], Tree] = RoverTree
