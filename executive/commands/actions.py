"""Text commands such as `VIDEO ON` (actions, thesis 5.1.3): `parse_action` and `perform`."""

from enum import Enum, unique
from typing import Final

from executive.values.ports import Video
from executive.values.reasons import Reason, Refusal


@unique
class Action(Enum):
    """A text command."""

    VIDEO_ON = "VIDEO ON"
    VIDEO_OFF = "VIDEO OFF"


HELP: Final = {
    Action.VIDEO_ON: "forward the camera's video stream to the ground",
    Action.VIDEO_OFF: "stop forwarding the camera's video stream",
}


def supported_actions(video: Video | None) -> tuple[Action, ...]:
    """Return the actions that an asset supports."""
    return () if video is None else (Action.VIDEO_ON, Action.VIDEO_OFF)


def parse_action(text: str, video: Video | None) -> Action | Refusal:
    """Parse an action from a line of text, ignoring case and extra spaces."""
    wanted = " ".join(text.upper().split())
    there = supported_actions(video)
    for action in there:
        if action.value == wanted:
            return action
    names = ", ".join(action.value for action in there) or "none"
    return Refusal(Reason.UNKNOWN_ACTION, f"there is no action {text[:40]!r}; there are: {names}")


def perform(text: str, video: Video | None) -> Refusal | None:
    """Execute an action; return a refusal if it is not available.

    Raises:
        OSError: the action failed.
    """
    action = parse_action(text, video)
    if isinstance(action, Refusal):
        return action
    if video is not None:
        video.set_enabled(action is Action.VIDEO_ON)
    return None
