"""`Placement`: state of another run, which a simulated rover continues."""

from dataclasses import dataclass

from executive.values.facts import CameraAngles, Odometry, SecondOdometry
from executive.values.geometry import STANDING, Pose, Velocity


@dataclass(frozen=True, slots=True, kw_only=True)
class Placement:
    """State of another run at the end of a period of the base, as far as it is known.

    Attributes:
        pose: in the world's frame.
        exact: whether the height and the inclination of the pose are those of this world's ground;
            otherwise the rover is put upright on it.
        commanded: velocity that the base follows; standing if it is stopped by itself.
        published: the last odometry that was published.
        measured: odometry that is measured, but not published; the last one is of this time.
        second: the last second odometry, and its pose at this time.
        inertial_errors: constant errors of accelerometer, gyro, roll and pitch.
    """

    pose: Pose
    exact: bool
    velocity: Velocity = STANDING
    commanded: Velocity = STANDING
    published: Odometry | None = None
    measured: tuple[Odometry, ...] = ()
    second: tuple[SecondOdometry, Pose] | None = None
    camera: CameraAngles | None = None
    charge_ratio: float | None = None
    inertial_errors: tuple[float, ...] | None = None
