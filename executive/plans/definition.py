"""A plan as mission control sends it."""

from dataclasses import dataclass


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
