"""What people type: angles, waypoints, and arguments that begin with a minus."""

from difflib import get_close_matches
from math import isfinite, pi, radians

import click

from executive.commands import Waypoint


def angle(text: str) -> float:
    """Return radians from `90deg`, `90°`, `1.57rad` or `1.57`.

    Raises:
        click.BadParameter: it is none, or a bare number of more than a turn, which means degrees.
    """
    angle_rad = _radians(text)
    if text[-1:].isdigit() and isfinite(angle_rad) and abs(angle_rad) > 2 * pi:
        raise click.BadParameter(f"{text} rad is more than a turn: write {text}deg for degrees")
    return angle_rad


def angular_speed(text: str) -> float:
    """Return radians a second from what is written as an angle."""
    return _radians(text)


def _radians(text: str) -> float:
    try:
        for unit in ("deg", "°"):
            if text.endswith(unit):
                return radians(float(text.removesuffix(unit)))
        return float(text.removesuffix("rad"))
    except ValueError as error:
        raise click.BadParameter(f"{text!r} is no angle: write 90deg, 1.57rad or 1.57") from error


def place(text: str) -> Waypoint:
    """Return a waypoint from `X,Y`, `X,Y,HEADING` or `X,Y,HEADING,TOLERANCE`.

    HEADING may be empty before a tolerance.
    """
    try:
        match text.split(","):
            case [x, y]:
                return Waypoint(float(x), float(y))
            case [x, y, heading]:
                return Waypoint(float(x), float(y), angle(heading))
            case [x, y, heading, tolerance]:
                heading_rad = angle(heading) if heading else None
                return Waypoint(float(x), float(y), heading_rad, float(tolerance))
            case _:
                raise ValueError(text)
    except ValueError as error:
        raise click.BadParameter(
            f"{text!r} is no waypoint: write X,Y or X,Y,HEADING or X,Y,HEADING,TOLERANCE, such as"
            " 1,0 or 1,0,90deg or 1,0,,0.1"
        ) from error


class Operation(click.Command):
    """A sub-command whose arguments may begin with a minus, and that explains a wrong option."""

    ignore_unknown_options = True

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Read what was typed.

        Raises:
            click.UsageError: an option is none, or one of `rover command` itself.
        """
        own = _names(self.get_params(ctx))
        above = set() if ctx.parent is None else _names(ctx.parent.command.params)
        for word in args:
            name = word.partition("=")[0]
            if word == "--":
                break
            if not word.startswith("--") or name in own:
                continue
            if name in above:
                raise click.UsageError(
                    f"{name} is an option of `rover command`: it stands before the operation,"
                    f" `rover command {word} {self.name} ...`",
                    ctx,
                )
            raise click.NoSuchOption(name, possibilities=get_close_matches(name, own), ctx=ctx)
        return super().parse_args(ctx, args)


def _names(parameters: list[click.Parameter]) -> set[str]:
    return {name for each in parameters if isinstance(each, click.Option) for name in each.opts}
