"""What a consumer subscribed to, and whom to call for each update."""

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from adapters.mal.codec import Codec
from adapters.mal.errors import DecodeError, MalError, StandardError
from adapters.mal.header import Header
from adapters.mal.mal_area import Subscription
from adapters.mal.specification import Specification

_LOG: Final = logging.getLogger(__name__)

OnUpdate = Callable[..., None]
"""Called as `on_update(update_header, *parts)` on the loop."""


class Subscriptions:
    """The subscriptions of one consumer, by the names of service and operation and their own id."""

    def __init__(self, specification: Specification, codec: Codec) -> None:
        """Begin without any."""
        self._specification = specification
        self._codec = codec
        self._on_update: dict[tuple[str, str, str], OnUpdate] = {}

    @contextmanager
    def added(
        self, service: str, operation: str, subscription: Subscription, on_update: OnUpdate
    ) -> Iterator[None]:
        """Add a subscription that is about to be registered; if that fails, all is as before."""
        key = (service, operation, subscription.subscriptionId)
        before = self._on_update.get(key)
        self._on_update[key] = on_update
        try:
            yield
        except BaseException:
            self._on_update.pop(key)
            if before is not None:
                self._on_update[key] = before
            raise

    def remove(self, service: str, operation: str, subscription_id: str) -> None:
        """Forget a subscription."""
        self._on_update.pop((service, operation, subscription_id), None)

    def notified(self, header: Header, body: bytes) -> None:
        """Hand an update to whom it is for; one that cannot be read is logged and dropped."""
        try:
            if header.is_error:
                raise self._codec.decode_error(body)
            operation = self._specification.resolve(
                header.area, header.area_version, header.service, header.operation
            )
            if header.stage not in operation.parts:
                raise MalError(StandardError.UNSUPPORTED_OPERATION)
            subscription_id, update, *parts = self._codec.decode(
                operation.parts[header.stage], body
            )
        except (DecodeError, MalError) as fault:
            _LOG.warning("notification from %s dropped: %s", header.from_uri, fault)
            return
        key = (operation.service_name, operation.name, subscription_id)
        on_update = self._on_update.get(key)
        if on_update is None:
            return
        try:
            on_update(update, *parts)
        except Exception:
            _LOG.exception("update of %s.%s, subscription %s", *key)
