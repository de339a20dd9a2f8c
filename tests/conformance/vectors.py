"""Files of vectors: octets of other implementations, and the values that they are known to carry.

Each stack decodes them, compares what it finds, encodes it again and compares the octets.
"""

import calendar
import json
import math
import struct
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, Final

import click

from executive.values.reports import printable

FILE: Final = click.argument("path", metavar="FILE", type=click.Path(path_type=Path))
VERBOSE: Final = click.option("--verbose", is_flag=True, help="Name what agrees, too.")
Vector = dict[str, Any]
"""An object of a file; nothing in it is checked yet."""
_NON_FINITE: Final = {"NaN": math.nan, "Infinity": math.inf, "-Infinity": -math.inf}


class VectorFileError(click.ClickException):
    """A file is no vector file."""

    exit_code = 2

    def __init__(self, path: Path, fault: object) -> None:
        super().__init__(printable(f"{path}: {fault}"))


@dataclass(frozen=True, slots=True)
class Verdict:
    """The result for one vector; without disagreements it agrees.

    Attributes:
        found: what is reported in any case; empty for nothing.
    """

    label: str
    disagreements: tuple[str, ...]
    found: str = ""


class Time(int):
    """A time in ns since 1970 UTC, which a file has as ISO 8601 text."""


class Single(float):
    """A float of 32 bits, which a file may have with more digits."""


Check = Callable[[Vector], Iterable[Verdict]]
"""Yields the verdicts on a whole file."""


def report(path: Path, check: Check, verbose: bool) -> None:
    """Check a file, and print each disagreement; end with 1 unless everything agrees, and with 2
    if the file cannot be used."""
    verdicts = _verdicts(path, check)
    for verdict in verdicts:
        for disagreement in verdict.disagreements:
            click.echo(printable(f"{verdict.label}: {disagreement}"))
        if not verdict.disagreements and (verbose or verdict.found):
            click.echo(printable(f"{verdict.label}: {verdict.found or 'agrees'}"))
    agree = sum(not verdict.disagreements for verdict in verdicts)
    click.echo(f"{agree} of {len(verdicts)} agree")
    if not agree or agree < len(verdicts):
        raise SystemExit(1)


def _verdicts(path: Path, check: Check) -> list[Verdict]:
    try:
        data = json.loads(path.read_bytes())
    except OSError as fault:
        raise VectorFileError(path, fault.strerror) from fault
    except (ValueError, RecursionError) as fault:
        raise VectorFileError(path, f"not JSON: {fault}") from fault
    try:
        vectors = data["vectors"]
        if not isinstance(vectors, list) or not all(isinstance(each, dict) for each in vectors):
            raise TypeError("vectors: no list of objects")
        return list(check(data))
    except (ArithmeticError, AttributeError, KeyError, TypeError, ValueError) as fault:
        raise VectorFileError(path, f"no vector file: {fault!r}") from fault


def judge(label: str, differences: Iterable[str], *refusals: type[Exception]) -> Verdict:
    """Return the verdict on a vector; a refusal to decode or encode it is a disagreement, too."""
    disagreements = []
    try:
        for difference in differences:
            disagreements.append(difference)
    except refusals as refusal:
        disagreements.append(str(refusal))
    return Verdict(label, tuple(disagreements))


def octets(data: Any, where: str) -> bytes:
    """Read hex."""
    try:
        return bytes.fromhex(data)
    except (TypeError, ValueError):
        raise ValueError(f"{where}: not hex") from None


def differing_octets(wanted: bytes, encoded: bytes) -> Iterator[str]:
    """Yield a line if what was decoded is encoded to other octets."""
    if encoded != wanted:
        pairs = enumerate(zip(encoded, wanted, strict=False))
        at = next((index for index, (ours, theirs) in pairs if ours != theirs), len(wanted))
        yield f"octets: others from octet {at} when encoded, {len(encoded)} in all"


def differing(wanted: Any, got: Any, path: str) -> Iterator[str]:
    """Yield one line for each place where what a file has differs from what was decoded."""
    match got:
        case dict() if isinstance(wanted, dict) and wanted.keys() == got.keys():
            for name in got:
                yield from differing(wanted[name], got[name], f"{path}.{name}")
            return
        case list() if isinstance(wanted, list) and len(wanted) == len(got):
            for index, (one, other) in enumerate(zip(wanted, got, strict=True)):
                yield from differing(one, other, f"{path}[{index}]")
            return
        case Time() if isinstance(wanted, str):
            same = _parse_time(wanted) == got
        case float():
            same = _is_number(wanted, got)
        case _:
            same = type(wanted) is type(got) and wanted == got
    if not same:
        yield f"{path}: {wanted!r} wanted, {got!r} decoded"


def _is_number(wanted: Any, got: float) -> bool:
    """Whether a JSON number, or the name of one that JSON does not have, is a number."""
    number = _NON_FINITE.get(wanted, wanted) if isinstance(wanted, str) else wanted
    if isinstance(number, bool) or not isinstance(number, int | float):
        return False
    try:
        if isinstance(got, Single):
            number = struct.unpack(">f", struct.pack(">f", number))[0]
        return float(number) == got or (number != number and got != got)
    except (OverflowError, struct.error):
        return False


def _parse_time(text: str) -> int:
    """Read an ISO 8601 UTC time such as `2018-06-15T12:34:56.789123456Z`, as ns since 1970 UTC."""
    moment, _, fraction = text.removesuffix("Z").partition(".")
    if not text.endswith("Z") or (fraction and not fraction.isdecimal()) or len(fraction) > 9:
        raise ValueError(f"{text!r} is no UTC time")
    seconds = calendar.timegm(datetime.fromisoformat(moment).timetuple())
    return seconds * 1_000_000_000 + int(fraction.ljust(9, "0"))
