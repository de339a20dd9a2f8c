"""Sets of octets of a block, as ranges."""

from collections.abc import Iterator


class Ranges:
    """Ranges from a begin to before an end; they are sorted and never touch."""

    def __init__(self) -> None:
        """Begin with none."""
        self._ranges: list[tuple[int, int]] = []

    def __iter__(self) -> Iterator[tuple[int, int]]:
        return iter(self._ranges)

    def add(self, begin: int, end: int) -> None:
        """Add a range."""
        apart = []
        for other_begin, other_end in self._ranges:
            if other_end < begin or other_begin > end:
                apart.append((other_begin, other_end))
            else:
                begin, end = min(begin, other_begin), max(end, other_end)
        if begin < end:
            apart.append((begin, end))
        self._ranges = sorted(apart)

    def remove(self, begin: int, end: int) -> None:
        """Remove a range."""
        kept = []
        for other_begin, other_end in self._ranges:
            kept.append((other_begin, min(other_end, begin)))
            kept.append((max(other_begin, end), other_end))
        self._ranges = [(left, right) for left, right in kept if left < right]

    def within(self, begin: int, end: int) -> list[tuple[int, int]]:
        """Return what is in a range."""
        cut = [(max(begin, left), min(end, right)) for left, right in self._ranges]
        return [(left, right) for left, right in cut if left < right]

    def gaps(self, begin: int, end: int) -> list[tuple[int, int]]:
        """Return what of a range is missing."""
        missing = []
        for left, right in self.within(begin, end):
            if begin < left:
                missing.append((begin, left))
            begin = right
        if begin < end:
            missing.append((begin, end))
        return missing

    def cover(self, begin: int, end: int) -> bool:
        """Return whether nothing of a range is missing."""
        return not self.gaps(begin, end)
