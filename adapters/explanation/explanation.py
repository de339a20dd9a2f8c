"""`Explanation`: a result with the chain of its causes."""

from dataclasses import dataclass

from executive.values.reasons import Figure, Reason, UnknownReason


class UnknownCommandError(LookupError):
    """A command or a node of a plan is unknown or ambiguous; the text lists the known ones."""


@dataclass(frozen=True, slots=True)
class ExplanationStep:
    """A step of the causal chain.

    Attributes:
        utc_s: onboard time, s UTC; None for a step without a time.
    """

    utc_s: float | None
    text: str


@dataclass(frozen=True, slots=True)
class Explanation:
    """Explanation of a command or state.

    Attributes:
        headline: the result in one sentence.
        reason: numbered reason; None if there is none, as for an executed command.
        steps: causes in the order of time.
        evidence: figures that support it.
    """

    headline: str
    reason: Reason | UnknownReason | None
    steps: tuple[ExplanationStep, ...]
    evidence: tuple[Figure, ...] = ()
