"""Octets that somebody spoilt: a few places changed, filled up, cut out or put something in."""

from collections.abc import Callable
from random import Random


def mutate(octets: bytes, random: Random, put: Callable[[bytearray, int], None]) -> bytes:
    """Return octets with one to three places spoilt.

    Args:
        octets: what is sound.
        random: chooses where and how.
        put: the fourth way beside the three that fit all octets; it changes them at a place.
    """
    changed = bytearray(octets)
    for _ in range(random.randrange(1, 4)):
        at = random.randrange(len(changed) + 1)
        match random.randrange(4):
            case 0:
                changed[at : at + 1] = random.randbytes(1)
            case 1:
                changed[at:at] = random.randbytes(random.randrange(1, 9))
            case 2:
                del changed[at : at + random.randrange(1, 9)]
            case _:
                put(changed, at)
    return bytes(changed)
