"""The commands `rover robot`: `new` makes both files of an asset, `check` is in `robot_check`."""

import re
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click
import yaml

from adapters.cli.robot_check import check
from adapters.process import program
from executive.settings import (
    Settings,
    SettingsError,
    asset_file,
    config_folder,
    installed_warning,
    load_settings,
    names_in,
    parse_yaml,
    structure,
)

if TYPE_CHECKING:
    from adapters.ros import FoundRobot, FoundTopic


@click.group()
def robot() -> None:
    """Make the files of a robot, and check them.

    \b
    Examples:
      rover robot new scout
      rover robot check scout
    """


NAME: Final = re.compile(r"[a-zA-Z](_?[a-zA-Z0-9])*")
"""Names that are valid in ROS, MAL and files."""
WIDTH: Final = 90
KEY: Final = re.compile(r"\s*(?:# )?(\w+):")


def _name(_: click.Context, __: click.Parameter, text: str) -> str:
    if not NAME.fullmatch(text):
        raise click.BadParameter(f"{text!r}: letters, digits and single _, a letter first")
    return text


def _namespace(_: click.Context, __: click.Parameter, text: str | None) -> str | None:
    if text is None:
        return None
    parts = text.strip("/").split("/") if text.strip("/") else []
    if not all(map(NAME.fullmatch, parts)):
        raise click.BadParameter(f"{text!r} is no ROS namespace: write robot1, or / for none")
    return "/" + "/".join(parts)


@click.command()
@click.argument("name", callback=_name)
@click.option("--like", metavar="ROBOT", help="Take the files of a robot in config/robots.")
@click.option("--minimal", is_flag=True, help="Take only what every robot needs.")
@click.option(
    "--namespace",
    callback=_namespace,
    help="ROS namespace of its topics; / for none.  [default: found, or of the file]",
)
@click.option("--seconds", default=10.0, show_default=True, help="Time of listening.")
def new(
    name: str,
    like: str | None,
    minimal: bool,
    namespace: str | None,
    seconds: float,
) -> None:
    """Make the two files of an asset: settings, and ROS topics.

    By default it listens to a robot on ROS, and writes the topics found. It prints the lines to
    check, and never overwrites a file.

    \b
    Examples:
      rover robot new scout                      from the topics of the robot that runs
      rover robot new scout --namespace robot1   the same, of several robots
      rover robot new scout --like turtlebot4    from the files of a known robot
      rover robot new scout --minimal
    """
    if like is not None and minimal:
        raise click.UsageError("--like and --minimal exclude each other")
    paths = [config_folder() / f"{name}{end}" for end in (".yaml", ".ros.yaml")]
    for path in paths:
        if path.exists():
            raise click.UsageError(f"{path} exists: choose another name, or remove it")
    try:
        if minimal:
            texts = renamed(MINIMAL, name, namespace or "/")
        elif like is not None:
            texts = renamed(shipped(like), name, namespace)
        else:
            texts = found(_listen(namespace, seconds), name)
        structure(parse_yaml(texts[0], str(paths[0])), Settings, str(paths[0]))
    except SettingsError as error:
        raise click.UsageError(str(error)) from error
    if warning := installed_warning(paths[0]):
        click.echo(f"Warning: {warning}", err=True)
    for path, text in zip(paths, texts, strict=True):
        try:
            with path.open("x", encoding="utf-8") as file:
                file.write(text)
        except OSError as error:
            raise click.ClickException(f"{path} cannot be written: {error.strerror}") from error
        click.echo(f"{path}: check")
        for number, line in enumerate(text.splitlines(), 1):
            key = KEY.match(line)
            if key is not None and (meaning := TO_CHECK.get(key[1])) is not None:
                click.echo(f"{number:4}  {line.strip()[:WIDTH]}\n        {meaning}")
    scripts = Path(sys.executable).parent
    click.echo(
        f"Then: {program()} robot check {name}\n      {scripts}/rover-executive --asset {name}"
    )


def _listen(namespace: str | None, seconds: float) -> "FoundRobot":
    """Return the robot on ROS; prints the chosen topics."""
    from adapters.ros import SurveyError, survey_robot, type_name

    click.echo(f"Listening for {seconds:g} s ...", err=True)
    try:
        robot = survey_robot(namespace, seconds)
    except SurveyError as error:
        raise click.ClickException(str(error)) from error
    click.echo(f"Found in namespace {robot.namespace}:")
    for key, topic in robot.topics.items():
        rate = "" if topic.rate_hz is None else f", {topic.rate_hz:.3g} Hz"
        problem = f"; not used: {topic.problem}" if topic.problem else ""
        others = f"; not chosen: {', '.join(topic.others)}" if topic.others else ""
        click.echo(f"  {key:15} {topic.name} ({type_name(topic.type)}{rate}){problem}{others}")
    return robot


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
    names = names_in(folder := config_folder() / "robots")
    if not names:
        raise SettingsError(f"--like: {folder} has no robots: set ROVER_CONFIG to all of config")
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


robot.add_command(check)
robot.add_command(new)
