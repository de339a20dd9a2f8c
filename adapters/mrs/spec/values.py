"""State, plans and reports of the core as MRS values, and back, and what others may tell.

A figure that is not known is NaN, or a value that is not VALID.
"""

from collections.abc import Mapping, Sequence
from math import isfinite, nan
from typing import Any, Final, Protocol

from adapters.mal import AttributeType, NamedValue, Typed
from adapters.mrs.spec import types
from adapters.mrs.spec.errors import invalid
from adapters.mrs.spec.types import Notification, NotificationKind, Severity, Stage, Validity
from executive.commands import PlanArgument, PlanDefinition
from executive.reports import Identity, Kind, PlanUpdate, Report
from executive.state import Parameter, ParameterValue

FRAME: Final = "odom"

LONGEST_SOURCE: Final = 256
"""Characters of a source's name: it comes back in every notification of its commands."""
LONGEST_NAME: Final = 64
LONGEST_TEXT: Final = 4096
MOST_FIGURES: Final = 32
"""Of a notification from outside, so that getNotifications can return a thousand at once."""
LONGEST_FIGURE: Final = 256
"""Characters or octets of what is no number among the figures of a notification."""

NUMBER_TYPES: Final = {
    AttributeType.FLOAT,
    AttributeType.DOUBLE,
    AttributeType.DURATION,
    AttributeType.OCTET,
    AttributeType.UOCTET,
    AttributeType.SHORT,
    AttributeType.USHORT,
    AttributeType.INTEGER,
    AttributeType.UINTEGER,
    AttributeType.LONG,
    AttributeType.ULONG,
}

NS_PER_S: Final = 1_000_000_000

DEFINED: Final = tuple(
    types.ParameterDefinition(
        name=parameter.value,
        description=parameter.description,
        type=AttributeType.DOUBLE,
        unit=parameter.unit,
        writable=parameter.writable,
    )
    for parameter in Parameter
)


def to_ns(utc_s: float) -> int:
    """Return nanoseconds since 1970 UTC, as MAL times are given; a float knows no more than µs."""
    return round(utc_s * 1e6) * 1000


class Asset(Protocol):
    """What knows the state of an asset: the executive aboard, or who hears its telemetry."""

    def parameters(self) -> Sequence[ParameterValue]:
        """Return the present values of all parameters, in the order of their definition."""
        ...


def parameter_value(value: ParameterValue) -> types.ParameterValue:
    """Return a parameter value for the wire."""
    known = value.value is not None
    return types.ParameterValue(
        name=value.parameter.value,
        timestamp=to_ns(value.utc_s),
        validity=Validity.VALID if known else Validity.INVALID,
        value=Typed(AttributeType.DOUBLE, value.value) if known else None,
    )


def pose(asset: Asset) -> types.Pose:
    """Return where the rover is."""
    figure = figures(asset)
    return types.Pose(
        frame=FRAME,
        x=figure[Parameter.POS_X],
        y=figure[Parameter.POS_Y],
        z=figure[Parameter.POS_Z],
        heading=figure[Parameter.HEAD],
    )


def speeds(asset: Asset) -> types.Speeds:
    """Return how fast the rover may move, and does."""
    figure = figures(asset)
    return types.Speeds(
        travelSpeed=figure[Parameter.TRAVEL_SPEED],
        rotateSpeed=figure[Parameter.ROTATE_SPEED],
        currentTravelSpeed=figure[Parameter.CURRENT_TRAVEL_SPEED],
        currentRotateSpeed=figure[Parameter.CURRENT_ROTATE_SPEED],
    )


def figures(asset: Asset) -> Mapping[Parameter, float]:
    """Return the present figures, NaN where they are not known."""
    return {
        value.parameter: nan if value.value is None else value.value for value in asset.parameters()
    }


MOST_ARGUMENTS: Final = 256

_TEXTS: Final = {AttributeType.STRING, AttributeType.IDENTIFIER, AttributeType.URI}


def definition_of(wire: types.PlanDefinition) -> PlanDefinition:
    """Return a plan that came.

    Raises:
        MalError: Invalid, an argument is neither text nor a number, or there are too many.
    """
    arguments = wire.arguments or ()
    if len(arguments) > MOST_ARGUMENTS:
        raise invalid(1)
    return PlanDefinition(
        wire.planId, wire.name, wire.format, wire.content, tuple(map(_argument, arguments))
    )


def wire_definition(plan: PlanDefinition) -> types.PlanDefinition:
    """Return a plan to send; its arguments travel as texts."""
    arguments = tuple(
        NamedValue(name=argument.name, value=Typed(AttributeType.STRING, argument.text))
        for argument in plan.arguments
    )
    return types.PlanDefinition(
        planId=plan.plan_id,
        name=plan.name,
        format=plan.format,
        content=plan.content,
        arguments=arguments or None,
    )


def wire_update(update: PlanUpdate) -> types.PlanUpdate:
    """Return how far a plan has come, to send."""
    return types.PlanUpdate(
        planId=update.plan_id,
        status=types.PlanStatus(update.status.value),
        timestamp=to_ns(update.utc_s),
        node=update.node or None,
        done=update.done,
        total=update.total,
        text=update.text or None,
    )


def _argument(given: NamedValue) -> PlanArgument:
    value = given.value
    if value is not None and value.type in _TEXTS:
        return PlanArgument(given.name, value.value)
    if value is not None and value.type in NUMBER_TYPES:
        return PlanArgument(given.name, repr(value.value))
    raise invalid(1)


_SOURCE: Final = "source"
_NUMBER: Final = "commandId"


def notification_of(report: Report) -> Notification:
    """Return the notification that carries a report; figures become parameters.

    Only what is of a command's life has its source and commandId: a LINK that is of one command
    names it in its parameters.
    """
    named = () if report.kind is Kind.COMMAND else _named(report.identity)
    whose = None if named else report.identity
    figures = tuple(
        NamedValue(name=figure.name, value=Typed(AttributeType.DOUBLE, float(figure.value)))
        for figure in report.figures
    )
    return Notification(
        kind=NotificationKind(report.kind.value),
        severity=Severity(report.severity.value),
        timestamp=to_ns(report.utc_s),
        sequence=report.sequence,
        commandId=whose.command_id if whose else None,
        source=whose.source if whose else None,
        stage=Stage(report.stage.value) if report.stage else None,
        step=report.step,
        stepCount=report.step_count,
        code=report.reason.value if report.reason else None,
        text=report.text,
        parameters=(*named, *figures) or None,
    )


def given_up(notification: Notification) -> Identity | None:
    """Return the command that a relay says it has given up; None if it says no such thing.

    This is no stage of its life, which the rover tells: it may not have reached the rover.
    """
    if (notification.kind, notification.severity) != (NotificationKind.LINK, Severity.ALARM):
        return None
    said = {each.name: each.value.value for each in notification.parameters or () if each.value}
    source, number = said.get(_SOURCE), said.get(_NUMBER)
    if not isinstance(source, str) or not isinstance(number, int):
        return None
    return Identity(source, number)


def _named(identity: Identity | None) -> tuple[NamedValue, ...]:
    if identity is None:
        return ()
    return (
        NamedValue(name=_SOURCE, value=Typed(AttributeType.IDENTIFIER, identity.source)),
        NamedValue(name=_NUMBER, value=Typed(AttributeType.LONG, identity.command_id)),
    )


def notification_keys(asset: str, notification: Notification) -> tuple[Any, ...]:
    """Return the subscription keys of a notification.

    What is of no command has no commandId: a 0 would be taken for "any" by brokers.
    """
    return (
        asset,
        notification.kind.value,
        notification.severity.value,
        notification.commandId or None,
        notification.stage.value if notification.stage else None,
    )


def is_valid_name(name: str) -> bool:
    """Whether an asset, a parameter or a service may be called so: short, printable, no spaces."""
    return 0 < len(name) <= LONGEST_NAME and name.isprintable() and " " not in name


def is_valid_value(value: types.ParameterValue) -> bool:
    """Whether it is a finite Double that is VALID, or nothing that is not."""
    if not is_valid_name(value.name):
        return False
    if value.value is None:
        return value.validity is not Validity.VALID
    return value.value.type is AttributeType.DOUBLE and isfinite(value.value.value)


def is_valid_notification(notification: Notification) -> bool:
    """Whether a notification is no larger than those of an executive."""
    figures = notification.parameters or ()
    return (
        len(notification.text or "") <= LONGEST_TEXT
        and len(notification.source or "") <= LONGEST_SOURCE
        and len(figures) <= MOST_FIGURES
        and all(
            len(figure.name) <= LONGEST_SOURCE
            and (figure.value is None or _size(figure.value.value) <= LONGEST_FIGURE)
            for figure in figures
        )
    )


def _size(value: Any) -> int:
    return len(value) if isinstance(value, str | bytes) else 0
