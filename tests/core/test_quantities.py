"""Quantities with units, as persons write them."""

from math import pi

import pytest

from executive.values.quantities import QuantityError, angle_text, rate_text, read_quantity


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("0.5", "m", 0.5),
        ("-50cm", "m", -0.5),
        (" 1 m ", "m", 1.0),
        (".5km", "m", 500.0),
        ("1e3", "m", 1000.0),
        ("10", "s", 10.0),
        ("10 min", "s", 600.0),
        ("1d", "s", 86400.0),
        ("90deg", "rad", pi / 2),
        ("-90 °", "rad", -pi / 2),
        ("1.57rad", "rad", 1.57),
        ("0", "rad", 0.0),
        ("45deg/s", "rad/s", pi / 4),
        ("45deg", "rad/s", pi / 4),
        ("36km/h", "m/s", 10.0),
        ("24", "V", 24.0),
    ],
)
def test_reads_a_quantity(text: str, unit: str, value: float) -> None:
    assert read_quantity(text, unit, bare=not unit.startswith("rad")) == value


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("5", "rad"),
        ("0.5", "rad/s"),
        ("5m", "rad"),
        ("90grad", "rad"),
        ("m", "m"),
        ("", "m"),
        ("nan", "m"),
        ("1e999", "m"),
        ("1_000", "m"),
        ("1,2", "m"),
        ("1,2,3", "m"),
    ],
)
def test_refuses_anything_else(text: str, unit: str) -> None:
    with pytest.raises(QuantityError):
        read_quantity(text, unit, bare=not unit.startswith("rad"))


def test_a_decimal_comma_is_read_where_one_number_is_expected() -> None:
    assert read_quantity("0,5", "m", comma=True) == 0.5
    assert read_quantity("-,5deg", "rad", comma=True) == read_quantity("-.5deg", "rad")
    with pytest.raises(QuantityError, match=r"is one number, 3\.2m, or two, 3 and 2m: write which"):
        read_quantity("3,2m", "m")


def test_angles_are_shown_in_degrees() -> None:
    assert (angle_text(pi / 2), rate_text(-1e-9, "z.2f")) == ("90.0°", "0.00°/s")
