"""What is known of other assets: addresses, the last value of each parameter, notifications."""

from dataclasses import dataclass, field
from typing import Final

from adapters.mal import Connection, MalError, StandardError
from adapters.mrs.spec import (
    LONGEST_NAME,
    AreaError,
    Notification,
    ParameterValue,
    is_valid_name,
    look_up,
    with_text,
)

MOST_NOTIFICATIONS: Final = 1000
MOST_OCTETS: Final = 1 << 20
"""Octets that they may take in memory, roughly: long texts leave room for fewer."""

_BARE: Final = 500
_FIGURE: Final = 350


class NotificationHistory:
    """Keeps notifications by their sequence numbers, which rise unless the asset's ledger is new.

    Attributes:
        last: the one with the highest number; None before any was heard.
    """

    def __init__(self) -> None:
        self.last: Notification | None = None
        self._kept: dict[int, Notification] = {}
        self._weight = 0

    def take(self, notification: Notification) -> bool:
        """Keep a notification; return whether it is news.

        One that is kept already is not news. A number that is not higher than the last, with other
        content, means that the asset has a new ledger: what was kept is dropped.
        """
        if self._kept.get(notification.sequence) == notification:
            return False
        if self.last is not None and notification.sequence <= self.last.sequence:
            self._kept.clear()
            self._weight = 0
        self.last = notification
        self._kept[notification.sequence] = notification
        self._weight += _weight(notification)
        while len(self._kept) > MOST_NOTIFICATIONS or self._weight > MOST_OCTETS:
            oldest = self._kept.pop(next(iter(self._kept)))
            self._weight -= _weight(oldest)
        return True

    def since(self, first: int, count: int) -> tuple[Notification, ...]:
        """Return what is kept from a sequence number on, oldest first, so many at most."""
        wanted = [kept for number, kept in self._kept.items() if number >= first]
        return tuple(wanted[:count])


def _weight(notification: Notification) -> int:
    figures = notification.parameters or ()
    return _BARE + 2 * len(notification.text or "") + _FIGURE * len(figures)


MOST_ASSETS: Final = 32
MOST_PARAMETERS: Final = 64


@dataclass(slots=True, eq=False)
class KnownAsset:
    """Another asset.

    Attributes:
        uri: where it serves the MRS, as far as is known.
        connection: over which it publishes here, if it is registered here.
        above: whether it is known from the service layer above.
        values: the last value heard of each parameter.
        history: the last notifications heard.
    """

    asset: str
    uri: str | None = None
    connection: Connection | None = None
    above: bool = False
    values: dict[str, ParameterValue] = field(default_factory=dict)
    history: NotificationHistory = field(default_factory=NotificationHistory)

    @property
    def publishes_here(self) -> bool:
        """Whether it publishes here itself, so that what others pass on of it is ignored."""
        return self.connection is not None and self.connection.is_open

    def take_value(self, value: ParameterValue) -> None:
        """Keep a value; raises TOO_MANY, it has more parameters than are kept."""
        if value.name not in self.values and len(self.values) == MOST_PARAMETERS:
            raise with_text(StandardError.TOO_MANY, f"{MOST_PARAMETERS} parameters at most")
        self.values[value.name] = value


class KnownAssets:
    """The other assets, by name.

    Args:
        own: the name of the asset that this is aboard of, which is none of the others.
    """

    def __init__(self, own: str) -> None:
        self._own = own
        self._others: dict[str, KnownAsset] = {}

    @property
    def others(self) -> tuple[KnownAsset, ...]:
        """All that are known."""
        return tuple(self._others.values())

    def find(self, asset: str) -> KnownAsset:
        """Return what is known of an asset; raises NotFound."""
        return look_up(self._others, asset)

    def knows(self, asset: str) -> bool:
        """Whether anything is known of an asset."""
        return asset in self._others

    def find_or_add(self, asset: str) -> KnownAsset:
        """Return what is known of an asset, from now on if it is new.

        When too many are known, one that was registered here and is disconnected is dropped.

        Raises:
            MalError: Invalid, it is no name; Duplicate, it is this asset's own name;
                TOO_MANY.
        """
        if asset in self._others:
            return self._others[asset]
        if not is_valid_name(asset):
            raise with_text(AreaError.INVALID, f"an asset's name: 1 to {LONGEST_NAME} characters")
        if asset == self._own:
            raise with_text(AreaError.DUPLICATE, asset)
        if len(self._others) == MOST_ASSETS:
            self._drop_one()
        self._others[asset] = KnownAsset(asset)
        return self._others[asset]

    def registered_over(self, asset: str, connection: Connection) -> KnownAsset:
        """Return the asset that is registered over a connection.

        Raises:
            MalError: Rejected, it is not this asset that is registered over this connection.
        """
        other = self._others.get(asset)
        if other is None or other.connection is not connection:
            raise _not_registered(asset[:80])
        return other

    def registered_by(self, connection: Connection) -> KnownAsset:
        """Return the asset that registered over a connection; raises Rejected if none did."""
        for other in self._others.values():
            if other.connection is connection:
                return other
        raise _not_registered("NAME")

    def _drop_one(self) -> None:
        for other in self._others.values():
            if not other.above and not other.publishes_here:
                del self._others[other.asset]
                return
        raise with_text(StandardError.TOO_MANY, f"{MOST_ASSETS} other assets at most")


def _not_registered(asset: str) -> MalError:
    text = f"register {asset}.ServiceLayer over this connection first"
    return with_text(AreaError.REJECTED, text)
