"""What the agent asks of a link, whichever protocol it speaks."""

from typing import Protocol

from adapters.bundle.gate import Outlook


class Link(Protocol):
    """One neighbour, over one protocol. It moves bundles between a node and the network.

    Whatever it puts into the node's transaction is committed by the agent, which then lets it
    pump.
    """

    @property
    def up(self) -> bool:
        """Whether it could send now, as far as it knows; what has no connection always could."""
        ...

    @property
    def last_heard_s(self) -> float | None:
        """When something came from the neighbour, in monotonic time; None for never."""
        ...

    @property
    def next_s(self) -> float | None:
        """When `tick` has something to do, in monotonic time."""
        ...

    def heed(self, outlook: Outlook) -> None:
        """Take note of whether there is contact."""
        ...

    def pump(self) -> None:
        """Send what waits, as far as the link takes it now.

        Raises:
            StoreError: the store cannot be read.
        """
        ...

    def tick(self) -> None:
        """Do what time asks for."""
        ...

    def close(self) -> None:
        """End; what was on its way waits again."""
        ...
