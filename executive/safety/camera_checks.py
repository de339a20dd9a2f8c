"""Whether a camera frame is the picture that was asked for."""

from typing import Final

from executive.values.facts import Frame
from executive.values.reasons import Figure, Reason, Refusal

EARLY_S: Final = 0.1
"""By which a stamp may lie before the request: offsets of clocks are known no better."""
END_WITHIN: Final = 1024
"""Octets from the end, in which a picture ends: some cameras pad."""
_ENDS: Final = {"JPG": b"\xff\xd9", "PNG": b"IEND"}


def frame_fault(
    frame: Frame, taken_s: float | None, asked_s: float, last_stamp_s: float | None
) -> Refusal | None:
    """Return what is wrong with a frame, or None.

    Args:
        frame: what arrived after the request.
        taken_s: when it was taken, on the core's time; None where its clock is not known.
        asked_s: when it was asked for.
        last_stamp_s: of the picture before.
    """
    end = _ENDS.get(frame.format)
    if end is not None and end not in frame.data[-END_WITHIN:]:
        size = len(frame.data)
        text = f"the camera's picture is cut: it has no end within its {size} octets"
        return Refusal(Reason.CAPTURE_CUT, text, (Figure("size", size, "octet"),))
    if taken_s is not None and taken_s < asked_s - EARLY_S:
        age_s = asked_s - taken_s
        text = f"the camera's picture is old: it was taken {age_s:.1f} s before it was asked for"
        return Refusal(Reason.CAPTURE_STALE, text, (Figure("age", age_s, "s"),))
    if frame.stamp_s == last_stamp_s:
        text = "the camera's picture is old: it has the stamp of the one before"
        return Refusal(Reason.CAPTURE_STALE, text)
    return None
