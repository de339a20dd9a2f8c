"""`RelayAuthority`: the authority for the relay's commands, as a message to `rover-nxt`.

The executive grants the authority. `rover-nxt` also forwards relay commands to the brick while the
executive is not running; it then applies the last received authority. The same message returns to
the executive after each command under the orbiter's authority, because that renews the lease.
"""

from dataclasses import dataclass

from adapters.mops.codec import Message, from_values, values_of
from adapters.mops.dictionary import OtherEntry


@dataclass(frozen=True, slots=True)
class RelayAuthority:
    """Authority that commands over the relay need.

    Attributes:
        needed: whether commands need the authority.
        holder: name of the holder; None if the authority is free.
        epoch: epoch of the orbiter's grant; None if the orbiter is not the holder.
        given_by: the only source that the orbiter may forward commands of; None for any source.
    """

    needed: bool
    holder: str | None = None
    epoch: int | None = None
    given_by: str | None = None

    def refusal_text(self, source: str, claimed: int | None) -> str:
        """Return the reason to refuse a command under a claimed epoch; empty if it is allowed."""
        if claimed is None and not self.needed:
            return ""
        if claimed is None:
            wrong = "a command needs the authority"
        elif claimed != self.epoch:
            wrong = f"the relay does not hold authority {claimed}"
        elif self.given_by not in {None, source}:
            wrong = f"{source} is not {self.given_by}, its grantor"
        else:
            return ""
        return f"{wrong}: {self.holder or 'no operator'} holds it"


def authority_message(
    authority: RelayAuthority, entry: OtherEntry, source: str, dest: str
) -> Message:
    """Return the message that carries an authority.

    Raises:
        MopsError: a value cannot be encoded.
    """
    return Message(entry.code, source, dest, entry.command, tuple(values_of(authority)))


def authority_of(message: Message) -> RelayAuthority:
    """Return the authority that a message carries.

    Raises:
        MopsError: the inputs are not an authority.
    """
    found: RelayAuthority = from_values(RelayAuthority, message.inputs)
    return found
