"""`plan_xml`: the calibration drive as a plan of velocities that are held one after the other."""

from typing import Final
from xml.etree import ElementTree

from executive.settings import DriveLimits

PATTERN: Final = (
    # Spins, lines, and arcs in both directions at several speeds, as (travel, rotate, seconds).
    *((0.0, rotate, 2.5) for rotate in (0.3, -0.7, 1.0, -1.0)),
    *((travel, 0.0, 2.0) for travel in (0.5, -0.5, 1.0, -1.0)),
    *(
        (direction * travel, rotate, 3.0)
        for travel, rotate in (
            *((0.3, 0.4), (0.3, -1.0), (0.6, 0.7), (0.6, -1.0)),
            *((1.0, 0.3), (1.0, -0.7), (1.0, 1.0), (1.0, -1.0)),
        )
        for direction in (1.0, -1.0)
    ),
)
"""Velocities as fractions of the asset's limits, with the duration of each."""
DEADLINE_S: Final = 15.0


def plan_xml(drive: DriveLimits) -> str:
    """Return the pattern as a plan for a rover with these limits.

    A drive that ends off target, as on a rover not yet calibrated, is also usable: the plan
    continues.
    """
    root = ElementTree.Element("root", BTCPP_format="4", main_tree_to_execute="Calibration")
    tree = ElementTree.SubElement(root, "BehaviorTree", ID="Calibration")
    sequence = ElementTree.SubElement(tree, "Sequence")
    for travel, rotate, duration_s in PATTERN:
        either = ElementTree.SubElement(sequence, "Fallback")
        ElementTree.SubElement(
            either,
            "drive",
            travel=f"{travel * drive.travel_speed_mps:g}",
            rotate=f"{rotate * drive.rotate_speed_radps:g}",
            duration=f"{duration_s:g}",
            deadline_s=f"{DEADLINE_S:g}",
        )
        ElementTree.SubElement(
            either,
            "setTravelSpeed",
            speed=f"{drive.travel_speed_mps:g}",
            deadline_s=f"{DEADLINE_S:g}",
        )
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"
