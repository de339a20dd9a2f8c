"""Whether a command is accepted: identity, arguments, lifetime, mode, queue. Changes nothing."""

from math import isfinite
from typing import Final

from executive.commands.catalogue import Command
from executive.commands.declaration import Family
from executive.commands.limits import check
from executive.commands.modes import ACCEPTED, Mode, advice, family
from executive.reasons import Figure, Reason, Refusal
from executive.settings import Settings
from executive.state import Status

PLAN_LINK: Final = "plan"
"""The link of the commands that a plan gives."""

SOURCE_PREFIX: Final = "plan:"
"""What the sources of plans begin with, and no other source may."""

QUEUED: Final = {Family.MOTION, Family.CAMERA, Family.INSTANT}
LOCATED: Final = {Family.MOTION, Family.PLAN_START}
"""What needs to know where the rover is: a plan would fail at its first motion."""


def source_of(plan_id: str) -> str:
    """Return the source of a plan's commands."""
    return f"{SOURCE_PREFIX}{plan_id}"


def expired(command: Command, utc_s: float, arrived_utc_s: float) -> Refusal | None:
    """Return why it is too late to start the command, or None."""
    if command.lifetime_s is None:
        return None
    created = arrived_utc_s if command.created_utc_s is None else command.created_utc_s
    age_s = utc_s - created
    if age_s <= command.lifetime_s:
        return None
    return Refusal(
        Reason.EXPIRED,
        f"it is {age_s:.3g} s old and was to live {command.lifetime_s:g} s",
        (Figure("age", age_s, "s"), Figure("lifetime", command.lifetime_s, "s")),
    )


def uses_reserved_source(command: Command) -> Refusal | None:
    """Return why the command's source is not its own, or None: only plans speak as plans.

    Such a command is not even written down, or its number would count among those of the plan.
    """
    if command.link == PLAN_LINK or not command.identity.source.startswith(SOURCE_PREFIX):
        return None
    return Refusal(
        Reason.BAD_IDENTITY,
        f"{command.identity}: sources that begin with {SOURCE_PREFIX} are those of plans",
        argument=0,
    )


def validate(
    command: Command, *, settings: Settings, status: Status, mode: Mode, queued: int, utc_s: float
) -> Refusal | None:
    """Return why the command must be refused, or None.

    Args:
        command: what came.
        settings: the asset's bounds.
        status: what the sensors say.
        mode: what the rover is about, as far as the command is concerned.
        queued: goals that wait or run already.
        utc_s: the time aboard.
    """
    request = command.request
    kin = family(request)
    if command.identity.command_id == 0 or not command.identity.source:
        return Refusal(
            Reason.BAD_IDENTITY, "a command needs a source and a number other than 0", argument=0
        )
    refusal = check(request, settings, status.pose.point) or expired(command, utc_s, utc_s)
    if refusal:
        return refusal
    if mode not in ACCEPTED[kin]:
        return Refusal(Reason.WRONG_MODE, advice(mode, request))
    if kin in LOCATED and not status.odometry_fresh:
        return Refusal(
            Reason.NO_ODOMETRY,
            f"no odometry {_since(status)}: the rover does not know where it is",
            (
                Figure("age", status.odometry_age_s, "s"),
                Figure("bound", settings.safety.odometry_stale_s, "s"),
            ),
        )
    if kin in QUEUED and queued >= settings.drive.queue_length:
        return Refusal(
            Reason.QUEUE_FULL,
            f"{queued} goals wait already: wait, or stop",
            (Figure("queued", queued), Figure("bound", settings.drive.queue_length)),
        )
    return None


def _since(status: Status) -> str:
    age_s = status.odometry_age_s
    return f"for {age_s:.2f} s" if isfinite(age_s) else "yet"
