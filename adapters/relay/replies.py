"""What the rover says on commands: by that it has them, whatever became of who published them.

A kill while a string is published leaves open whether the rover has it. So nothing that is said on
a command counts as kept before its bundle counts as delivered: on what the next process finds
undelivered, the rover says again what it has to say, if it has it.
"""

from collections.abc import Sequence

from adapters.mops.message import Message

_Key = tuple[str, int | None, int | None]


class Replies:
    """Remembers on which commands something was said. Used by one thread, all but one method."""

    def __init__(self) -> None:
        """Nothing was said yet."""
        self._handed: frozenset[_Key] = frozenset()
        self._unanswered: set[_Key] = set()
        self._held: list[Message] = []
        self._said: set[_Key] | None = set()

    def answered(self) -> bool:
        """Return whether something was said on all that is handed over; on any thread."""
        return not self._unanswered

    def begin(self, commands: Sequence[Message]) -> None:
        """Wait for replies to commands that are handed over from now on."""
        self._handed = frozenset(map(_asked, commands))
        self._unanswered = set(self._handed)

    def end(self) -> Sequence[Message]:
        """Return what was held while commands were handed over, which counts as delivered now."""
        held, self._held = self._held, []
        self._handed = frozenset()
        return held

    def holds(self, message: Message) -> bool:
        """Take note of what the rover says; return whether it is held, so that order is kept."""
        key = (message.dest, message.moe_inputs_id, message.moe_inputs_counter)
        if self._said is not None:
            self._said.add(key)
        self._unanswered.discard(key)
        if not self._held and key not in self._handed:
            return False
        self._held.append(message)
        return True

    def news(self, commands: Sequence[Message]) -> Sequence[Message]:
        """Return those commands on which nothing was said since the start."""
        said = self._said or set()
        return [each for each in commands if _asked(each) not in said]

    def forget(self) -> None:
        """Remember no longer what is said, for all is new that comes now."""
        self._said = None


def _asked(command: Message) -> _Key:
    return command.source, command.moe_inputs_id, command.moe_inputs_counter
