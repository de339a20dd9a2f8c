"""Plans as MRS values, and back."""

from typing import Final

from adapters.mal import AttributeType, NamedValue, Typed
from adapters.mrs import types
from adapters.mrs.errors import invalid
from adapters.mrs.headers import to_ns
from executive.commands import PlanArgument, PlanDefinition
from executive.reports import PlanUpdate

MOST_ARGUMENTS: Final = 256

_TEXTS: Final = {AttributeType.STRING, AttributeType.IDENTIFIER, AttributeType.URI}
_NUMBERS: Final = {
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
    if value is not None and value.type in _NUMBERS:
        return PlanArgument(given.name, repr(value.value))
    raise invalid(1)
