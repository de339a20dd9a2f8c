"""Monitors of the rover as a whole: how it leans, its battery, and who else drives it."""

from executive.fault_table import Row
from executive.reasons import Figure
from executive.safety.evidence import Evidence
from executive.safety.history import History


def tilted(history: History, row: Row, _: float) -> Evidence | None:
    """See that the rover leans, by its odometry."""
    if history.odometry is None:
        return None
    pose = history.odometry.pose
    tilt_rad = max(abs(pose.roll_rad), abs(pose.pitch_rad))
    if tilt_rad <= row.bound:
        return None
    figures = Figure("tilt", tilt_rad, "rad"), Figure("bound", row.bound, "rad")
    return Evidence(f"the rover leans by {tilt_rad:.2f} rad", figures)


def battery_low(history: History, row: Row, _: float) -> Evidence | None:
    """See that the battery is nearly empty."""
    if history.battery is None or history.battery.voltage_v >= row.bound:
        return None
    voltage_v = history.battery.voltage_v
    figures = Figure("voltage", voltage_v, "V"), Figure("bound", row.bound, "V")
    return Evidence(f"the battery is down to {voltage_v:.1f} V", figures)


def other_publisher(history: History, _: Row, __: float) -> Evidence | None:
    """See that the base obeys somebody else."""
    drivers = ", ".join(str(each) for each in history.inputs if each.above)
    return Evidence(f"{drivers} drives the rover") if drivers else None
