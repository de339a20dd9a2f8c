"""Work that needs no actuator: files moved or deleted, text commands."""

from typing import Final

from py_trees.common import Status

from executive.actions import perform
from executive.commands import DeleteFile, ExecuteAction, MoveFile
from executive.reasons import Reason, Refusal
from trees.leaf import Condition, GoalLeaf

DEADLINE_S: Final = 5.0


class WantsErrand(Condition):
    """Whether an errand waits. Starts it."""

    def holds(self) -> bool:
        """Take the goal."""
        return self.context.errands.take() is not None


class Errand(GoalLeaf):
    """Does what can be done at once, and ends the goal."""

    def begin(self) -> float:
        """Allow more than it needs: it is done in the tick in which it begins."""
        return DEADLINE_S

    def act(self) -> Status:
        """Do it."""
        try:
            refusal = self._do()
        except OSError as error:
            refusal = Refusal(Reason.ERRAND_FAILED, f"it could not be done: {error.strerror}")
        if refusal is not None:
            return self.fail(refusal)
        self.queue.execute()
        return Status.SUCCESS

    def give_up(self) -> Status:
        """Fail the goal."""
        return self.fail(Refusal(Reason.ERRAND_FAILED, f"not done within {DEADLINE_S:g} s"))

    def _do(self) -> Refusal | None:
        context = self.context
        match self.goal.command.request:
            case DeleteFile(path):
                return context.files.delete(path)
            case MoveFile(path, target):
                return context.files.move(path, target)
            case ExecuteAction(text):
                return perform(text, context.video)
            case request:
                raise TypeError(f"{request} is no errand")
