"""The two files of an asset as text: minimal, after one in config/robots, or of a found robot."""

import re
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Final

import yaml

from executive.settings import SettingsError, asset_file, config_folder, load_settings, names_in

if TYPE_CHECKING:
    from adapters.ros import FoundRobot, FoundTopic

MINIMAL: Final = Path(__file__).with_name("minimal.yaml")
TO_CHECK: Final = {
    "travel_speed_mps": "maximum, below that of the base",
    "rotate_speed_radps": "maximum, below that of the base",
    "min_turning_radius_m": "of a base that cannot turn on the spot, a car; use controller: mpc",
    "control_point_m": "0 for a differential drive; `rover calibrate` finds that of skid steering",
    "latency_s": "from a velocity to the odometry that shows it: `rover calibrate` finds it",
    "battery_low": "3.2 V for each cell of a lithium battery",
    "imu": "its frame has to be parallel to base_link's; leave it out if the wheels slip in turns",
    "joints": "names of the wheels by side, front first; their radius, and the effective track",
    "laser": "its frame has to be parallel to base_link's",
    "odometry": "that of the robot's filter (EKF), if it has one",
    "emergency_stop": "true has to mean stopped",
    "cmd_vel": "Twist or TwistStamped, as the base subscribes",
}
"""Note on a key of the files, for the user."""
BATTERY_LOW: Final = 0.85
"""Low voltage of the battery, as a part of the present one: 3.2 V of 3.8 V for a lithium cell."""
SECOND: Final = 50
"""Depth of the queues that have to hold a second, at least; others have 5, or 1."""
DEPTHS: Final = {"odometry": SECOND, "imu": SECOND, "joints": SECOND, "camera": 1, "cmd_vel": 1}
MAX_WIDTH: Final = 1000
SENSORS: Final = {
    "imu": "  imu: {rate_hz: %g}\n",
    "joints": "  # joints: {rate_hz: %g, wheel_radius_m: 0.1, track_m: 0.5}\n",
    "laser": "  # laser: {rate_hz: %g}\n",
}
"""Those that need figures of the robot, or a check of their frame, are comments."""


def renamed(source: Path, name: str, namespace: str | None) -> tuple[str, str]:
    """Return settings and topics of an asset under another name.

    Args:
        source: its settings file, beside that of its topics.
        name: the other name.
        namespace: prefix of relative names of topics, `/` for none; None: they remain.
    """
    settings, topics = (
        path.read_text(encoding="utf-8") for path in (source, source.with_suffix(".ros.yaml"))
    )
    own = rf"(?m)^((?:asset|description|domain):.*)\b{source.stem}\b"
    head = f"# Topics of {name}. Names without a leading slash are in the namespace /{name}.\n"
    topics = re.sub(r"\A(#.*\n)*", head, topics, count=1)
    if namespace is not None:
        topics = re.sub(r"\btopic: (?=\w)", f"topic: {namespace.rstrip('/')}/", topics)
    return re.sub(own, rf"\g<1>{name}", settings), topics


def shipped(wanted: str) -> Path:
    """Return the settings of a robot in config/robots, by a part of its name or description.

    Raises:
        SettingsError: no robot is meant, or several.
    """
    names = names_in(config_folder() / "robots")
    about = {each: f"{each} {load_settings(f'robots/{each}').description}" for each in names}
    meant = [each for each in names if each == wanted] or [
        each for each, text in about.items() if wanted.lower() in text.lower()
    ]
    if len(meant) != 1:
        there = f"may be {' or '.join(meant)}" if meant else f"is none of {', '.join(names)}"
        raise SettingsError(f"--like: {wanted!r} {there}")
    return asset_file(f"robots/{meant[0]}")


def found(robot: "FoundRobot", name: str) -> tuple[str, str]:
    """Return settings and topics of a robot that was found; what does not fit is a comment."""
    settings, topics = renamed(MINIMAL, name, None)
    lines = "".join(_topic(each) for each in robot.topics.values())
    topics = re.sub(r"(?m)(^    (odometry|cmd_vel):.*\n)+", lambda _: lines, topics)
    if robot.simulated_time:
        topics = topics.replace("use_sim_time: false", "use_sim_time: true")
    return settings + _sections(robot), topics


def _topic(topic: "FoundTopic") -> str:
    from adapters.ros import type_name, wheels_of

    qos, depth = topic.qos, DEPTHS.get(topic.key, 5)
    latched = {"durability": "transient_local"} if qos.durability.name == "TRANSIENT_LOCAL" else {}
    entry: dict[str, object] = {
        "topic": topic.name,
        "type": type_name(topic.type),
        "reliability": qos.reliability.name.lower(),
        **latched,
        "depth": max(depth, int(_rounded(topic.rate_hz or 0.0))) if depth == SECOND else depth,
    }
    if topic.key == "joints" and not topic.problem:
        entry |= asdict(wheels_of(topic.last))
    text = yaml.safe_dump(entry, default_flow_style=True, sort_keys=False, width=MAX_WIDTH)
    line = f"{topic.key}: {text}".strip()
    if topic.problem and topic.key != "odometry":
        line = f"# {line}  # {topic.problem}"
    return f"    {line}\n" + ("    camera_hz: 5.0\n" if topic.key == "camera" else "")


def _sections(robot: "FoundRobot") -> str:
    from adapters.ros import frame_fact, voltage_v

    usable = {key: each for key, each in robot.topics.items() if not each.problem}
    text = ""
    if camera := usable.get("camera"):
        picture = camera.last
        text += f"\ncamera:\n  formats: [{frame_fact(picture).format}]\n"
        if hasattr(picture, "width"):
            text += f"  width_px: {picture.width}\n  height_px: {picture.height}\n"
    if battery := usable.get("battery"):
        now_v = voltage_v(battery.last)
        text += f"\n# It had {now_v:.1f} V.\nfaults:\n"
        text += f"  battery_low: {{below: {BATTERY_LOW * now_v:.1f}}}\n"
    rates = {key: usable[key].rate_hz for key in SENSORS if key in usable}
    lines = "".join(SENSORS[key] % _rounded(each) for key, each in rates.items() if each)
    return text + (f"\n{'' if rates.get('imu') else '# '}sensors:\n{lines}" if lines else "")


def _rounded(rate_hz: float) -> float:
    return float(f"{rate_hz:.2g}")
