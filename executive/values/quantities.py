"""Quantities with units, as persons write them: `50cm`, `90deg`, `10 min`, `0,5`.

`read_quantity` reads one, `angle_text` formats an angle. Values are in SI units and radians.
"""

import re
from math import degrees, isfinite, radians
from types import MappingProxyType
from typing import Final

_DEGREES: Final = degrees(1.0)
_ANGLES: Final = {"rad": 1.0, "deg": _DEGREES, "°": _DEGREES}
UNITS: Final = MappingProxyType(
    {
        "m": {"m": 1.0, "cm": 100.0, "mm": 1000.0, "km": 0.001},
        "s": {"s": 1.0, "ms": 1000.0, "min": 1 / 60, "h": 1 / 3600, "d": 1 / 86400},
        "rad": _ANGLES,
        "m/s": {"m/s": 1.0, "cm/s": 100.0, "mm/s": 1000.0, "km/h": 3.6},
        "rad/s": {"rad/s": 1.0, "deg/s": _DEGREES, "°/s": _DEGREES, **_ANGLES},
    }
)
"""Accepted units of a quantity, by its SI unit, with their number per SI unit."""
_SUFFIXES: Final = {"m": "m", "s": "s", "rad": "rad", "mps": "m/s", "radps": "rad/s"}
_EXAMPLES: Final = {
    "m": "0.5, 0.5m or 50cm",
    "s": "10, 10s or 2min",
    "rad": "90deg or 1.57rad",
    "m/s": "0.5 or 0.5m/s",
    "rad/s": "30deg/s or 0.5rad/s",
}
_QUANTITY: Final = re.compile(
    r"([-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:e[-+]?\d+)?)\s*(\D*)", re.ASCII | re.I
)
_DECIMAL_COMMA: Final = re.compile(r"([-+]?\d*),(\d+)(\D*)", re.ASCII)


class QuantityError(ValueError):
    """A text that is no quantity of the unit; the message has the accepted forms."""


def unit_of(field: str) -> str:
    """Return the SI unit that the suffix of a field names, as `x_m`; empty for none."""
    return _SUFFIXES.get(field.rpartition("_")[2], "")


def read_quantity(text: str, unit: str, *, bare: bool = True, comma: bool = False) -> float:
    """Return a quantity in its SI unit.

    Args:
        text: a number, possibly with a unit of `UNITS`.
        unit: the SI unit.
        bare: whether the unit may be omitted; it always may for zero.
        comma: whether a decimal comma is accepted: only where exactly one number is expected.

    Raises:
        QuantityError: it is no such quantity, or the unit is missing.
    """
    text, units = text.strip(), UNITS.get(unit, {"": 1.0})
    if found := _DECIMAL_COMMA.fullmatch(text):
        whole, decimals, written = found.groups()
        if not comma:
            one, two = f"{whole or 0}.{decimals}{written}", f"{whole or 0} and {decimals}{written}"
            raise QuantityError(f"{text!r} is one number, {one}, or two, {two}: write which")
        text = f"{whole or 0}.{decimals}{written}"
    found = _QUANTITY.fullmatch(text)
    if found is None or found[2] not in {"", *units} or not isfinite(float(found[1])):
        example = _EXAMPLES.get(unit, "a number")
        raise QuantityError(f"{text!r} is no quantity in {unit or 'figures'}: write {example}")
    value, written = float(found[1]), found[2]
    if not written and not bare and value:
        degrees_unit, own = ("deg/s", "rad/s") if unit == "rad/s" else ("deg", unit)
        raise QuantityError(f"{text} has no unit: write {text}{degrees_unit} or {text}{own}")
    per_unit = units.get(written, 1.0)
    return radians(value) if per_unit == _DEGREES else value / per_unit


def display_unit(unit: str) -> tuple[float, str]:
    """Return the number of display units per SI unit, and their symbol: degrees for angles."""
    if unit in {"rad", "rad/s"}:
        return _DEGREES, f"°{unit.removeprefix('rad')}"
    return 1.0, unit


def quantity_text(value: float, unit: str, spec: str | None = None) -> str:
    """Return a value with its unit, for display: angles in degrees, other values in SI units."""
    per_unit, shown = display_unit(unit)
    if per_unit != 1.0:
        return f"{value * per_unit:{spec or '.4g'}}{shown}"
    return f"{value:{spec or 'g'}} {unit}".rstrip()


def angle_text(angle_rad: float, spec: str = "z.1f") -> str:
    """Return an angle in degrees, formatted by `spec`."""
    return f"{degrees(angle_rad):{spec}}°"


def rate_text(rate_radps: float, spec: str = "z.1f") -> str:
    """Return an angular speed in degrees per second, formatted by `spec`."""
    return f"{angle_text(rate_radps, spec)}/s"
