"""What went over the link to each neighbour, counted where it happens, since the start."""

from dataclasses import dataclass


@dataclass(slots=True)
class Traffic:
    """What went to a neighbour and came from it.

    Attributes:
        sent: bundles and fragments given to the link, each time that they are.
        acknowledged: bundles that the neighbour has said to have, or their receiver of those that
            were sent with `confirm`.
        retransmitted: what was sent once more: segments over LTP, and bundles.
        expired: bundles for it that ended here with their lifetime.
        received: bundles and fragments that came from it and could be read.
        round_trip_s: how long the neighbour took to answer what was sent only once; None before the
            first answer, and over links without answers.
    """

    sent: int = 0
    acknowledged: int = 0
    retransmitted: int = 0
    expired: int = 0
    received: int = 0
    round_trip_s: float | None = None
