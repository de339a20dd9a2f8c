"""What mission control says of a plan, and what it hears."""

from dataclasses import dataclass
from enum import Enum, unique


@dataclass(frozen=True, slots=True)
class PlanArgument:
    """A value given to a plan, which its nodes read as `{name}`; the text is as in XML."""

    name: str
    text: str


@dataclass(frozen=True, slots=True)
class PlanDefinition:
    """A plan as it was sent.

    Attributes:
        format: how to read the content; `BTCPP4` is known.
        content: the octets of the text.
    """

    plan_id: str
    name: str
    format: str
    content: bytes
    arguments: tuple[PlanArgument, ...] = ()


@unique
class PlanStatus(Enum):
    """Where a plan is in its life (numbers as on the MRS wire)."""

    SUBMITTED = 1
    ACTIVATED = 2
    EXECUTING = 3
    SUSPENDED = 4
    COMPLETED = 5
    FAILED = 6
    ABORTED = 7

    @property
    def running(self) -> bool:
        """Whether the plan has the rover."""
        return self in {PlanStatus.ACTIVATED, PlanStatus.EXECUTING}


@dataclass(frozen=True, slots=True)
class PlanUpdate:
    """How far a plan has come.

    Attributes:
        node: path of the leaf that began or ended last; empty if none did.
        done: how many leaves have ended at least once.
        total: how many leaves there are.
    """

    plan_id: str
    status: PlanStatus
    utc_s: float
    node: str
    done: int
    total: int
    text: str
