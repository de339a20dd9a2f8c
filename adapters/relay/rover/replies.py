"""What the rover says on commands: by that it has them, whatever became of who published them.

A kill while a string is published leaves open whether the rover has it. So nothing that is said on
a command counts as kept before its bundle counts as delivered: on what the next process finds
undelivered, the rover says again what it has to say, if it has it.
"""

from collections.abc import Sequence

from adapters.mops import Message

_Key = tuple[str, int | None, int | None]


class Replies:
    """Remembers on which commands nothing was said. Used by one thread, all but one method."""

    def __init__(self) -> None:
        """Nothing is handed over."""
        self._handed: Sequence[Message] = ()
        self._unanswered: frozenset[_Key] = frozenset()
        self._held: list[Message] = []

    def answered(self) -> bool:
        """Return whether something was said on all that is handed over; on any thread."""
        return not self._unanswered

    def awaited(self) -> Sequence[Message]:
        """Return those of the commands on which nothing was said yet."""
        return [each for each in self._handed if _asked(each) in self._unanswered]

    def begin(self, commands: Sequence[Message]) -> None:
        """Wait for replies to commands that are handed over from now on, or were before."""
        self._handed = commands
        self._unanswered = frozenset(map(_asked, commands))

    def end(self) -> Sequence[Message]:
        """Return what was held while commands were handed over, which counts as delivered now."""
        held, self._held = self._held, []
        self.begin(())
        return held

    def holds(self, message: Message) -> bool:
        """Take note of what the rover says; return whether it is held, so that order is kept."""
        key = (message.dest, message.moe_inputs_id, message.moe_inputs_counter)
        answers = any(_asked(each) == key for each in self._handed)
        if message.moe_inputs_id is not None:
            self._unanswered -= {key}
        if not answers and not self._held:
            return False
        self._held.append(message)
        return True


def _asked(command: Message) -> _Key:
    return command.source, command.moe_inputs_id, command.moe_inputs_counter
