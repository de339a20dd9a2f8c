"""Findings about what the camera saw: pictures stored aboard, video that came to the ground."""

from io import BytesIO
from typing import Final

from sim.scenario.expectations import Pictures, VideoComes
from sim.scenario.finding import NEVER, Finding
from sim.scenario.record import Record

LEAST_CONTRAST: Final = 16
"""Between the darkest and the brightest pixel of a picture that shows something, of 255."""


def pictures(expected: Pictures, record: Record) -> Finding:
    """Look into the pictures that the rover has stored."""
    size = f"{expected.width_px or 'any'} × {expected.height_px or 'any'}"
    paths = sorted(record.files.glob("pictures/*.jpg"))
    faults = [
        f"{path.name} {fault}"
        for path in paths
        if (fault := _fault(path.read_bytes(), expected.width_px, expected.height_px))
    ]
    return Finding(
        "pictures",
        f"{expected.pictures} stored, {size} px, showing something",
        ", ".join([f"{len(paths)} stored", *faults]),
        len(paths) == expected.pictures and not faults,
    )


def video(expected: VideoComes, record: Record) -> Finding:
    """Look into the pictures that arrived in a while; where none is wanted, at every datagram."""
    wanted = f"at least {expected.video} pictures" if expected.video else "nothing arrives"
    wanted = f"{wanted} {expected.period}"
    if record.moment(expected) is None:
        return Finding("video", wanted, NEVER, False)
    arrived = record.during(record.video, expected)
    came = [each.picture for each in arrived if each.picture is not None]
    faults = [fault for picture in came if (fault := _fault(picture))]
    seen = f"{len(came)} pictures, {len(arrived)} datagrams"
    enough = len(came) >= expected.video if expected.video else not arrived
    return Finding("video", wanted, ", ".join([seen, *faults]), enough and not faults)


def _fault(octets: bytes, width_px: int | None = None, height_px: int | None = None) -> str:
    from PIL import Image

    try:
        with Image.open(BytesIO(octets), formats=["JPEG"]) as picture:
            size_px = picture.size
            darkest, brightest = picture.convert("L").getextrema()
    except OSError as error:
        return f"does not decode ({error})"
    if width_px not in (None, size_px[0]) or height_px not in (None, size_px[1]):
        return f"is {size_px[0]} × {size_px[1]} px"
    contrast = brightest - darkest  # type: ignore[operator]  # one band gives one pair
    return "is blank" if contrast < LEAST_CONTRAST else ""
