"""The authority over an asset as `rover-nxt` is told of it: which commands of the relay have it.

The executive grants the authority; `rover-nxt`, which passes the relay's commands on to a brick
without it, keeps what it was told last. The same message goes back to the executive after each
command that went by the orbiter's authority, since that renews the lease.
"""

from dataclasses import dataclass

from adapters.mops.codec import Message, made_of, values_of
from adapters.mops.dictionary import OtherEntry


@dataclass(frozen=True, slots=True)
class RelayAuthority:
    """By which authority commands may come by the relay.

    Attributes:
        needed: whether commands need the authority.
        holder: who holds it; None for nobody.
        epoch: of the orbiter's grant; None while it holds none.
        given_by: whose commands the orbiter may pass on by it; None for everybody's.
    """

    needed: bool
    holder: str | None = None
    epoch: int | None = None
    given_by: str | None = None

    def fault(self, source: str, claimed: int | None) -> str:
        """Return why a source may not command by an epoch that it claims; empty if it may."""
        if claimed is None and not self.needed:
            return ""
        if claimed is None:
            wrong = "a command needs the authority"
        elif claimed != self.epoch:
            wrong = f"the relay does not hold authority {claimed}"
        elif self.given_by not in {None, source}:
            wrong = f"{source} is not {self.given_by}, who gave it"
        else:
            return ""
        return f"{wrong}: {self.holder or 'nobody'} holds it"


def authority_message(
    authority: RelayAuthority, entry: OtherEntry, source: str, dest: str
) -> Message:
    """Return the message that tells an authority.

    Raises:
        MopsError: it cannot be spelled.
    """
    return Message(entry.code, source, dest, entry.command, tuple(values_of(authority)))


def authority_of(message: Message) -> RelayAuthority:
    """Return the authority that a message tells.

    Raises:
        MopsError: it tells none.
    """
    found: RelayAuthority = made_of(RelayAuthority, message.inputs)
    return found
