"""Rovers that read one another, and what they know."""

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

from adapters.mal import Certificates
from adapters.mrs.fleet.fleet_link import FleetLink
from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import AssetMode, ReceivedReport
from adapters.mrs.transport import CLEAR, TransportSettings
from tests.mrs.aboard import Aboard

LIMIT_S = 60.0


def eventually(holds: Callable[[], bool]) -> None:
    """Wait until something holds, which other processes or threads bring about."""
    deadline_s = time.monotonic() + LIMIT_S
    while not holds():
        assert time.monotonic() < deadline_s
        time.sleep(0.02)


def modes(rover: Aboard) -> dict[str, AssetMode]:
    """Return the assets that a rover knows of, by name, with their modes."""

    async def session(client: MrsClient) -> dict[str, AssetMode]:
        return {asset.asset: asset.mode for asset in await client.list_assets()}

    return rover.ground(session)


def value(rover: Aboard, asset: str, name: str) -> float | None:
    """Return what a rover last heard of another's parameter; None if that is nothing."""

    async def session(client: MrsClient) -> float | None:
        if asset not in {known.asset for known in await client.list_assets()}:
            return None
        found = {value.name: value.value for value in await client.get_asset_value(asset)}
        figure = found.get(name)
        return figure if isinstance(figure, float) else None

    return rover.ground(session)


def reported(rover: Aboard, asset: str) -> tuple[ReceivedReport, ...]:
    """Return what a rover heard another report; nothing if it knows no such."""

    async def session(client: MrsClient) -> tuple[ReceivedReport, ...]:
        if asset not in {known.asset for known in await client.list_assets()}:
            return ()
        return await client.get_asset_notifications(asset)

    return rover.ground(session)


def own(rover: Aboard) -> tuple[ReceivedReport, ...]:
    """Return what a rover reported."""
    return rover.ground(lambda client: client.get_notifications())


def was_reported(rover: Aboard, text: str) -> bool:
    """Whether a rover reported something in these words."""
    return any(text in received.report.text for received in own(rover))


def joined(rover: Aboard) -> bool:
    """Whether a rover said that it is registered."""
    return was_reported(rover, "registered as")


def services(rover: Aboard) -> dict[str, str]:
    """Return a rover's directory: addresses by names."""

    async def session(client: MrsClient) -> dict[str, str]:
        return {service.name: service.providerURI for service in await client.get_services()}

    return rover.ground(session)


async def _send_nothing(_: FleetLink) -> None:
    """Leave without farewell."""


class Fleet:
    """Rovers that register at one another, all on the same terms but for their certificates."""

    def __init__(
        self,
        folder: Path,
        terms: TransportSettings = CLEAR,
        certificates: Mapping[str, Certificates] | None = None,
    ) -> None:
        self._folder = folder
        self._terms = terms
        self._certificates = certificates or {}
        self._rovers: list[Aboard] = []

    def launch(self, asset: str, above: Aboard | None = None, port: int | None = None) -> Aboard:
        """Start a rover; with another above, return when it is registered there."""
        rover = Aboard(
            self._folder / asset,
            port,
            replace(self._terms, certificates=self._certificates.get(asset)),
            asset=asset,
            service_layer=None if above is None else above.uri,
        )
        self._rovers.append(rover)
        if above is not None:
            eventually(lambda: f"{asset}.ServiceLayer" in services(above))
        return rover

    def kill(self, rover: Aboard) -> None:
        """End a rover as kill -9 does: it says farewell to nobody."""
        self._rovers.remove(rover)
        with patch.object(FleetLink, "leave", _send_nothing):
            rover.die()

    def close(self, rover: Aboard) -> None:
        """End a rover in order."""
        self._rovers.remove(rover)
        rover.close()

    def close_all(self) -> None:
        while self._rovers:
            self._rovers.pop().close()
