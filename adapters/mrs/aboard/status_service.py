"""The rover's state: the operations that read it, and the twelve parameters as telemetry."""

import asyncio
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Final

from adapters.mal import Call
from adapters.mrs import spec as wire
from adapters.mrs.aboard.gateway import Gateway
from adapters.mrs.aboard.served_operations import ServedOperations
from adapters.mrs.spec import (
    DEFINED,
    AreaError,
    invalid,
    is_valid_value,
    parameter_value,
    require_few,
    with_text,
)
from executive.runner import Executive
from executive.settings import Settings
from executive.state import Parameter, ParameterValue

READS: Final[tuple[tuple[str, str, Callable[[Executive], Any]], ...]] = (
    ("Action", "listActions", wire.actions),
    ("MotionControl", "getPose", wire.pose),
    ("MotionControl", "getSpeeds", wire.speeds),
    ("Camera", "getState", wire.camera_state),
    ("Status", "getStatusInterval", lambda executive: executive.status_interval_s),
    ("Status", "getStatus", wire.asset_status),
)


def serve_state(offer: ServedOperations, core: Gateway) -> None:
    """Put up all operations of `READS`."""
    for service, operation, read in READS:
        offer.serve(service, operation, partial(_read, core, read))


def _read(
    core: Gateway, read: Callable[[Executive], Any], _: Call
) -> asyncio.Future[tuple[Any, ...]]:
    return core.ask(lambda executive: (read(executive),))


SERVICE: Final = "Monitoring"

_NAMES: Final = {parameter.value for parameter in Parameter}


class MonitoringService:
    """Serves the four operations; `publish` is called on the provider's loop.

    Args:
        on_value: called with each value that is broadcast.
    """

    def __init__(
        self,
        offer: ServedOperations,
        core: Gateway,
        settings: Settings,
        on_value: Callable[[wire.ParameterValue], None],
    ) -> None:
        """Put the operations up."""
        self._core = core
        self._settings = settings
        self._on_value = on_value
        self._publisher = offer.publisher(SERVICE, "monitorValue")
        offer.serve(SERVICE, "publishParameters", self._take)
        offer.serve(SERVICE, "getValue", self._get)
        offer.serve(SERVICE, "listDefinition", lambda _: (DEFINED,))

    def publish(self, values: Sequence[ParameterValue]) -> None:
        """Broadcast values of the rover's own."""
        for value in values:
            self._broadcast(parameter_value(value), self._settings.asset)

    def _take(self, call: Call, values: tuple[wire.ParameterValue, ...]) -> None:
        """Broadcast the values of another component. The rover's own state is not touched."""
        require_few(values)
        for value in values:
            _require(value.name)
            if not is_valid_value(value):
                raise invalid(0)
        for value in values:
            self._broadcast(value, call.from_uri)

    def _get(
        self, call: Call, names: tuple[str, ...]
    ) -> asyncio.Future[tuple[tuple[wire.ParameterValue, ...]]]:
        return present_values(self._core, names)

    def _broadcast(self, value: wire.ParameterValue, source: str | None) -> None:
        self._publisher.publish(
            value,
            keys=(self._settings.asset, value.name),
            domain=self._settings.domain,
            source=source,
            droppable=True,
        )
        self._on_value(value)


def present_values(
    core: Gateway, names: Sequence[str]
) -> asyncio.Future[tuple[tuple[wire.ParameterValue, ...]]]:
    """Return the asset's present values, all if none is named.

    Raises:
        MalError: NotFound, there is no such parameter; TOO_MANY.
    """
    require_few(names)
    for name in names:
        _require(name)
    wanted = names or tuple(parameter.value for parameter in Parameter)
    return core.ask(lambda executive: (_select(executive.parameters(), wanted),))


def _select(
    values: Sequence[ParameterValue], names: Sequence[str]
) -> tuple[wire.ParameterValue, ...]:
    by_name = {value.parameter.value: parameter_value(value) for value in values}
    return tuple(by_name[name] for name in names)


def _require(name: str) -> None:
    if name not in _NAMES:
        raise with_text(AreaError.NOT_FOUND, name)
