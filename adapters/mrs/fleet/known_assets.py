"""`KnownAssets`: addresses, last parameter values and notifications of the other assets."""

from dataclasses import dataclass, field
from typing import Final

from adapters.mal import Connection, MalError, StandardError
from adapters.mrs.spec import (
    MAX_NAME_LENGTH,
    AreaError,
    Notification,
    ParameterValue,
    find_or_raise,
    is_valid_name,
    with_text,
)

MAX_NOTIFICATIONS: Final = 1000
MAX_OCTETS: Final = 1 << 20
"""Maximum estimated octets of an asset's notifications: long texts leave space for fewer."""

_BARE: Final = 500
_FIGURE: Final = 350


class NotificationHistory:
    """Stores notifications by sequence number; numbers rise unless the asset has a new ledger.

    Attributes:
        last: the one with the maximum number; None before the first.
    """

    def __init__(self) -> None:
        self.last: Notification | None = None
        self._notifications: dict[int, Notification] = {}
        self._weight = 0

    def add(self, notification: Notification) -> bool:
        """Store a notification; return whether it is new.

        A number not above the last, with other content, means that the asset has a new ledger: all
        stored ones are dropped.
        """
        if self._notifications.get(notification.sequence) == notification:
            return False
        if self.last is not None and notification.sequence <= self.last.sequence:
            self._notifications.clear()
            self._weight = 0
        self.last = notification
        self._notifications[notification.sequence] = notification
        self._weight += _weight(notification)
        while len(self._notifications) > MAX_NOTIFICATIONS or self._weight > MAX_OCTETS:
            removed = self._notifications.pop(next(iter(self._notifications)))
            self._weight -= _weight(removed)
        return True

    def since(self, first: int, count: int) -> tuple[Notification, ...]:
        """Return at most `count` notifications from a sequence number on, oldest first."""
        wanted = [each for number, each in self._notifications.items() if number >= first]
        return tuple(wanted[:count])


def _weight(notification: Notification) -> int:
    figures = notification.parameters or ()
    return _BARE + 2 * len(notification.text or "") + _FIGURE * len(figures)


MAX_ASSETS: Final = 32
MAX_PARAMETERS: Final = 64


@dataclass(slots=True, eq=False)
class KnownAsset:
    """Another asset.

    Attributes:
        uri: address of its MRS; None if unknown.
        connection: connection over which it publishes here; None if it is not registered here.
        above: whether it is known from the upstream service layer.
        values: the last received value of each parameter.
        history: the last received notifications.
    """

    asset: str
    uri: str | None = None
    connection: Connection | None = None
    above: bool = False
    values: dict[str, ParameterValue] = field(default_factory=dict)
    history: NotificationHistory = field(default_factory=NotificationHistory)

    @property
    def publishes_here(self) -> bool:
        """Whether it publishes here itself, so that its forwarded updates are ignored."""
        return self.connection is not None and self.connection.is_open

    def add_value(self, value: ParameterValue) -> None:
        """Store a value; raises TOO_MANY above `MAX_PARAMETERS` parameters."""
        if value.name not in self.values and len(self.values) == MAX_PARAMETERS:
            raise with_text(StandardError.TOO_MANY, f"at most {MAX_PARAMETERS} parameters")
        self.values[value.name] = value


class KnownAssets:
    """The other assets, by name.

    Args:
        own: the name of this asset, which is not one of the others.
    """

    def __init__(self, own: str) -> None:
        self._own = own
        self._others: dict[str, KnownAsset] = {}

    @property
    def others(self) -> tuple[KnownAsset, ...]:
        """All known assets."""
        return tuple(self._others.values())

    def find(self, asset: str) -> KnownAsset:
        """Return a known asset; raises NotFound."""
        return find_or_raise(self._others, asset)

    def knows(self, asset: str) -> bool:
        """Whether an asset is known."""
        return asset in self._others

    def find_or_add(self, asset: str) -> KnownAsset:
        """Return a known asset; adds it if it is new.

        If the list is full, an asset that was registered here and is disconnected is dropped.

        Raises:
            MalError: Invalid, the name is not valid; Duplicate, it is this asset's own name;
                TOO_MANY.
        """
        if asset in self._others:
            return self._others[asset]
        if not is_valid_name(asset):
            raise with_text(
                AreaError.INVALID, f"an asset's name: 1 to {MAX_NAME_LENGTH} characters"
            )
        if asset == self._own:
            raise with_text(AreaError.DUPLICATE, asset)
        if len(self._others) == MAX_ASSETS:
            self._drop_one()
        self._others[asset] = KnownAsset(asset)
        return self._others[asset]

    def registered_over(self, asset: str, connection: Connection) -> KnownAsset:
        """Return the asset that is registered over a connection.

        Raises:
            MalError: Rejected, another asset or none is registered over this connection.
        """
        other = self._others.get(asset)
        if other is None or other.connection is not connection:
            raise _not_registered(asset[:80])
        return other

    def registered_by(self, connection: Connection) -> KnownAsset:
        """Return the asset that is registered over a connection; raises Rejected if none is."""
        for other in self._others.values():
            if other.connection is connection:
                return other
        raise _not_registered("NAME")

    def _drop_one(self) -> None:
        for other in self._others.values():
            if not other.above and not other.publishes_here:
                del self._others[other.asset]
                return
        raise with_text(StandardError.TOO_MANY, f"at most {MAX_ASSETS} other assets")


def _not_registered(asset: str) -> MalError:
    text = f"register {asset}.ServiceLayer over this connection first"
    return with_text(AreaError.REJECTED, text)
