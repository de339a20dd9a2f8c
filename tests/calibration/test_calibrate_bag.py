"""`rover calibrate --bag`: a latency and a turning point are found again in a bag of the drive."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from adapters.calibration import calibrate, drive_of
from adapters.calibration.drive_log import PATTERN
from executive.settings import Settings, load_settings
from executive.values.facts import Odometry
from executive.values.geometry import STANDING, Pose, Velocity
from sim.calibration.commands import calibrate as command
from tests.robots.bags import Arrivals, write_bag
from tests.robots.interfaces import INTERFACES
from tests.robots.motion import STEP_S, Motion
from tests.suite import CHECKOUT

AGE_S = 0.01
LATENCY_TOLERANCE_S, POINT_TOLERANCE_M = 0.005, 0.002
REST_S = 1.5
ROBOT = "robots/clearpath_j100"
CMD_VEL, ODOMETRY = "/clearpath_j100/cmd_vel", "/clearpath_j100/platform/odom/filtered"


def commands(settings: Settings) -> Iterable[tuple[float, Velocity]]:
    """Yield the pattern within the limits of a rover, as it is sent in each tick."""
    drive, now = settings.drive, STANDING
    tick, tick_s = 0, settings.tick_s
    for travel, rotate, duration_s in PATTERN:
        wanted = Velocity(travel * drive.travel_speed_mps, rotate * drive.rotate_speed_radps)
        for velocity, held_s in ((wanted, duration_s), (STANDING, REST_S)):
            for _ in range(round(held_s / tick_s)):
                now = Velocity(
                    nearer(now.travel_mps, velocity.travel_mps, drive.travel_acceleration_mps2),
                    nearer(
                        now.rotate_radps, velocity.rotate_radps, drive.rotate_acceleration_radps2
                    ),
                )
                yield tick * tick_s, now
                tick += 1


def nearer(now: float, wanted: float, acceleration: float, step_s: float = 0.05) -> float:
    return now + max(-acceleration * step_s, min(acceleration * step_s, wanted - now))


def driven(
    sent: Iterable[tuple[float, Velocity]], dead_s: float, lag_s: float, point_m: float
) -> list[tuple[float, Odometry]]:
    """Return the odometry of a stand-in that turns about a point ahead of base_link, at 50 Hz."""
    interface = INTERFACES["clearpath_j100"]
    body = replace(interface.base, dead_s=dead_s, lag_s=lag_s, turn_slip=0.0)
    motion, found = Motion(replace(interface, base=body, emergency_stop=None)), []
    for at_s, velocity in sent:
        motion.command(velocity.travel_mps, velocity.rotate_radps)
        while motion.now_s < at_s + 0.05 - STEP_S / 2:
            motion.step()
            if round(motion.now_s / STEP_S) % 4 == 0:
                point = Pose(motion.x_m, motion.y_m, heading_rad=motion.odometry_rad)
                speeds = Velocity(motion.travel_mps, motion.odometry_radps)
                base = point.ahead(-point_m)
                pose = Pose(base.x_m, base.y_m, heading_rad=motion.odometry_rad)
                fact = Odometry(motion.now_s, pose, speeds)
                found.append((motion.now_s + AGE_S, fact))
    return found


SETTINGS = load_settings(ROBOT)
SENT = list(commands(SETTINGS))


@pytest.mark.parametrize(
    ("dead_s", "lag_s", "point_m"),
    [(0.02, 0.08, 0.0), (0.1, 0.02, 0.05), (0.25, 0.1, -0.1), (0.02, 0.25, 0.03)],
)
def test_latency_and_turning_point_are_found(dead_s: float, lag_s: float, point_m: float) -> None:
    arrived = sorted([*SENT, *driven(SENT, dead_s, lag_s, point_m)], key=lambda each: each[0])
    found = calibrate(drive_of(SETTINGS, arrived, Path("a"))).settings
    # A velocity is held for a tick: on average it acts half of one later.
    latency_s = dead_s + lag_s + SETTINGS.tick_s / 2 + AGE_S
    assert found["turn_drive.latency_s"] == pytest.approx(latency_s, abs=LATENCY_TOLERANCE_S)
    assert found["turn_drive.control_point_m"] == pytest.approx(point_m, abs=POINT_TOLERANCE_M)


def test_without_a_true_path_the_pose_of_the_odometry_is_not_corrected() -> None:
    arrived = sorted([*SENT, *driven(SENT, 0.02, 0.08, 0.05)], key=lambda each: each[0])
    found = calibrate(drive_of(SETTINGS, arrived, Path("a"))).settings
    assert SETTINGS.mpc.odometry_slip is None
    assert found["mpc.slip.offset_m"] == pytest.approx(0.05, abs=POINT_TOLERANCE_M)
    assert not any(key.startswith("mpc.odometry_slip") for key in found)


def test_repeated_and_reordered_stamps_do_no_harm() -> None:
    odometry = driven(SENT, 0.02, 0.08, 0.05)
    late = [(at_s + 0.05, fact) for at_s, fact in odometry[::7]]
    arrived = sorted([*SENT, *odometry, *late], key=lambda each: each[0])
    found = calibrate(drive_of(SETTINGS, arrived, Path("a"))).settings
    assert found["turn_drive.control_point_m"] == pytest.approx(0.05, abs=POINT_TOLERANCE_M)


def test_a_car_has_no_turning_point() -> None:
    car = replace(SETTINGS, drive=replace(SETTINGS.drive, min_turning_radius_m=0.5))
    arrived = sorted([*SENT, *driven(SENT, 0.02, 0.08, 0.0)], key=lambda each: each[0])
    found = calibrate(drive_of(car, arrived, Path("a"))).settings
    assert "turn_drive.latency_s" in found
    assert "turn_drive.control_point_m" not in found


def files(folder: Path) -> Path:
    """Return the file of an asset whose base receives velocities as Twist."""
    for name in ("clearpath_j100.yaml", "clearpath_j100.ros.yaml"):
        text = (CHECKOUT / "config" / "robots" / name).read_text(encoding="utf-8")
        (folder / name).write_text(text, encoding="utf-8")
    return folder / "clearpath_j100.yaml"


def calibrated(own: Path, path: Path, *options: str) -> Result:
    return CliRunner().invoke(command, ["--asset", str(own), "--bag", str(path), *options])


@pytest.mark.ros
@pytest.mark.usefixtures("ros_domain")
@pytest.mark.parametrize("kind", ["mcap", "db3", "bag"])
def test_the_figures_of_a_bag_are_written(kind: str, tmp_path: Path) -> None:
    own, odometry = files(tmp_path), driven(SENT, 0.1, 0.02, 0.05)
    path = write_bag(tmp_path, kind, {ODOMETRY: odometry, CMD_VEL: SENT})
    done = calibrated(own, path, "--write")
    assert done.exit_code == 0, done.output
    assert f"{own} has the new figures" in done.output
    law = load_settings(str(own)).turn_drive
    assert law.latency_s == pytest.approx(0.155, abs=LATENCY_TOLERANCE_S)
    assert law.control_point_m == pytest.approx(0.05, abs=POINT_TOLERANCE_M)
    assert "# The track is the effective one" in own.read_text(encoding="utf-8")


DRIVEN = driven(SENT, 0.02, 0.08, 0.0)
STOPPED = [(at_s, STANDING) for at_s, _ in SENT]


@pytest.mark.ros
@pytest.mark.usefixtures("ros_domain")
@pytest.mark.parametrize(
    ("topics", "status", "text"),
    [
        ({CMD_VEL: SENT}, 2, "no topic of type nav_msgs/msg/Odometry"),
        ({ODOMETRY: DRIVEN}, 2, f"has no velocity commands on {CMD_VEL}: record"),
        (
            {ODOMETRY: DRIVEN, "/joy_vel": SENT, "/nav_vel": SENT},
            2,
            f"has no velocity commands on {CMD_VEL}; it has /joy_vel, /nav_vel: record",
        ),
        ({ODOMETRY: DRIVEN[:300], CMD_VEL: SENT}, 1, "5 m and 6 rad are needed at least"),
        ({ODOMETRY: DRIVEN, CMD_VEL: STOPPED}, 1, "the rover did not follow these commands"),
    ],
    ids=["odometry", "commands", "several", "short", "another"],
)
def test_a_bag_without_a_usable_drive_is_one_error(
    topics: dict[str, Arrivals], status: int, text: str, tmp_path: Path
) -> None:
    done = calibrated(files(tmp_path), write_bag(tmp_path, "mcap", topics))
    assert done.exit_code == status, done.output
    assert text in " ".join(done.output.split())


def test_a_bag_and_a_recording_exclude_each_other(tmp_path: Path) -> None:
    done = CliRunner().invoke(command, ["run.mcap", "--bag", str(tmp_path)])
    assert done.exit_code == 2
    assert "choose one" in done.output
