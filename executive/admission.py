"""The answer to a command on its arrival, for the link that brought it."""

from dataclasses import dataclass

from executive.lifecycle import Life
from executive.reasons import Refusal
from executive.reports import Report


@dataclass(frozen=True, slots=True)
class Admitted:
    """It was accepted and written down; reports, and its life, tell the rest."""

    life: Life


@dataclass(frozen=True, slots=True)
class Refused:
    """It will not be executed."""

    refusal: Refusal


@dataclass(frozen=True, slots=True)
class Repeated:
    """The same command came before; this was the last report on it, and it is sent again."""

    last: Report


Admission = Admitted | Refused | Repeated
