"""`frame_fault` refuses a camera frame that is truncated or outdated."""

from typing import Final

from executive.values.facts import Frame
from executive.values.reasons import Figure, Reason, Refusal

STAMP_TOLERANCE_S: Final = 0.1
"""Maximum lead of the request over a stamp: clock offsets are known no better."""
END_WITHIN: Final = 1024
"""Octets from the end within which the end marker must be: some cameras pad."""
_ENDS: Final = {"JPG": b"\xff\xd9", "PNG": b"IEND"}


def frame_fault(
    frame: Frame, taken_s: float | None, requested_s: float, last_stamp_s: float | None
) -> Refusal | None:
    """Return a refusal if the frame is truncated or outdated, or None.

    Args:
        frame: the first one after the request.
        taken_s: time of exposure, on the core's time; None if its clock is unknown.
        requested_s: time of the request.
        last_stamp_s: of the previous picture.
    """
    end = _ENDS.get(frame.format)
    if end is not None and end not in frame.data[-END_WITHIN:]:
        size = len(frame.data)
        text = f"camera picture truncated: no end marker in its {size} octets"
        return Refusal(Reason.CAPTURE_TRUNCATED, text, (Figure("size", size, "octet"),))
    if taken_s is not None and taken_s < requested_s - STAMP_TOLERANCE_S:
        age_s = requested_s - taken_s
        text = f"camera picture outdated: taken {age_s:.1f} s before the request"
        return Refusal(Reason.CAPTURE_STALE, text, (Figure("age", age_s, "s"),))
    if frame.stamp_s == last_stamp_s:
        text = "camera picture outdated: it has the stamp of the previous one"
        return Refusal(Reason.CAPTURE_STALE, text)
    return None
