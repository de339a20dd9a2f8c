"""The command `rover robot new`: makes both files of an asset, settings and ROS topics."""

import re
from typing import TYPE_CHECKING, Final

import click

if TYPE_CHECKING:
    from adapters.ros import FoundRobot

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
    from adapters.cli.robot_files import MINIMAL, TO_CHECK, found, renamed, shipped
    from executive.settings import Settings, SettingsError, config_folder, parse_yaml, structure

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
    click.echo(f"Then: ./rover robot check {name}\n      .venv/bin/rover-executive --asset {name}")


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
