"""The assets: the links to each, and what is heard of them as messages."""

import asyncio
import logging
from collections.abc import Awaitable, Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

from adapters.console.command_life import FORWARDED, GIVEN_UP
from adapters.console.messages import (
    AssetState,
    Broadcast,
    DictionaryChanged,
    FileChanged,
    LinkKind,
    LinkState,
    LinkStatus,
    Notified,
    PlanProgress,
    Quality,
    Sample,
    Scalar,
    TreeNode,
    TreeState,
)
from adapters.console.rovers.authority_desk import OperatorAuthority
from adapters.console.rovers.dictionary import (
    AssetEntry,
    command_entries,
    parameter_entries,
    zone_entries,
)
from adapters.console.rovers.rover_link import LINK_HOUSEKEEPING, LastNotification, RoverLink
from adapters.console.rovers.shared_commands import SharedCommands
from adapters.console.rovers.tracker import CommandTracker
from adapters.console.tasks import begin, end
from adapters.mal import NamedValue, TypedAttribute
from adapters.mrs.ground import FileNotification
from adapters.mrs.spec import (
    AssetStatus,
    AuthorityStatus,
    Notification,
    ParameterDefinition,
    ParameterValue,
    PlanUpdate,
    ServiceDescriptor,
    Validity,
    forwarded,
    given_up,
)
from adapters.mrs.terms import TransportSettings
from adapters.system import System
from executive.settings import Settings, SettingsError, config_folder, load_settings, names_in
from executive.values.reports import Identity
from trees import TreeSnapshot, looks, served

_LOG: Final = logging.getLogger(__name__)

NS_PER_S: Final = 1e9
NS_PER_US: Final = 1000
AHEAD_NS: Final = 2_000_000_000
"""A value that is further ahead of the asset's clock was told before that was set back."""
_LAYER: Final = ".ServiceLayer"


@dataclass(slots=True)
class ConnectedAsset:
    """An asset that was reached.

    Attributes:
        settings: what it may do, by the settings of its name that are installed here; None where
            there are none.
        entry: what there is to see and to command.
        links: the ways to it.
    """

    settings: Settings | None
    entry: AssetEntry
    links: dict[LinkKind, RoverLink] = field(default_factory=dict)

    def best_link(self) -> RoverLink | None:
        """Return the link by which it is reached soonest; None if it cannot be reached."""
        found = [self.links[kind] for kind in LinkKind if kind in self.links]
        return next((link for link in found if link.state is LinkState.UP), None)


class Fleet:
    """Keeps a link with each address, and with what is registered there; a `Listener` of them.

    Args:
        uris: the addresses.
        terms: agreed on with all of them.
        publish: sends a message to whoever wants it.
        sample: the same for a telemetry value.
        tree: the same for a behaviour tree.
        last_known: returns the last notification that was kept of an asset by a link.
        tracker: hears what becomes of commands.
        commands: knows those that other consoles sent.
        desk: hears who may command.
        system: the time.
    """

    def __init__(
        self,
        uris: Iterable[str],
        terms: TransportSettings,
        publish: Callable[[Broadcast], None],
        sample: Callable[[Sample], None],
        tree: Callable[[TreeState], None],
        last_known: Callable[[str, LinkKind], Awaitable[LastNotification | None]],
        tracker: CommandTracker,
        commands: SharedCommands,
        desk: OperatorAuthority,
        system: System,
    ) -> None:
        self._terms, self._system = terms, system
        self._publish = publish
        self._sample = sample
        self._tree = tree
        self._last_known = last_known
        self._tracker, self._commands, self._desk = tracker, commands, desk
        self._links = [RoverLink(uri, terms, self, system) for uri in uris]
        self._running: dict[RoverLink, asyncio.Task[None]] = {}
        self.assets: dict[str, ConnectedAsset] = {}
        self._newest: dict[tuple[str, str, LinkKind], ParameterValue] = {}
        self._states: dict[tuple[str, LinkKind], AssetState] = {}
        self._heard: dict[tuple[str, LinkKind], LastNotification] = {}

    def start(self) -> None:
        """Begin to connect."""
        for link in self._links:
            self._run(link)

    async def close(self) -> None:
        """Hang up everywhere."""
        await end(self._running.values())

    def entries(self) -> Iterator[AssetEntry]:
        """Yield what there is of each asset that was reached."""
        return (asset.entry for asset in self.assets.values())

    def video_of(self, asset: str) -> tuple[str, int] | None:
        """Return where an asset's video goes by its settings; None where that is not known."""
        known = self.assets.get(asset)
        if known is None or known.settings is None or known.settings.video is None:
            return None
        return known.settings.video.to_host, known.settings.video.to_port

    def on_asset(self, link: RoverLink, definitions: tuple[ParameterDefinition, ...]) -> None:
        """Take in what an asset is."""
        assert link.info is not None
        name = link.asset
        known = self.assets.get(name)
        settings = _settings_of(name) if known is None else known.settings
        parameters = {
            entry.key: entry
            for entry in (
                *(() if known is None else known.entry.parameters),
                *parameter_entries(definitions, settings),
                *parameter_entries((each.definition for each in LINK_HOUSEKEEPING), settings),
            )
        }
        entry = AssetEntry(
            asset=name,
            description=link.info.description,
            version=link.info.softwareVersion,
            ranges_known=settings is not None,
            parameters=tuple(parameters.values()),
            commands=command_entries(settings),
            zones=zone_entries(settings),
            footprint=None if settings is None else settings.footprint,
        )
        if known is None:
            known = self.assets[name] = ConnectedAsset(settings, entry)
        former = known.links.get(link.kind, link)
        known.links[link.kind] = link
        if former is not link and former not in self._links and former.state is LinkState.DOWN:
            self._running.pop(former).cancel()  # it is at this address now
        self._forget_after(link, 0)  # its clock may have been set back meanwhile
        if known.entry != entry or len(known.links) == 1:
            known.entry = entry
            self._publish(DictionaryChanged(name))

    def on_state(self, link: RoverLink) -> None:
        """Tell how a link is, unless the asset was reached at another address since."""
        known = self.assets.get(link.asset)
        if known is not None and known.links.get(link.kind) is not link:
            return
        self._publish(
            LinkStatus(
                link.asset,
                link.kind,
                link.uri,
                link.state,
                link.since_s,
                link.heard_s,
                link.detail,
            )
        )

    def on_value(self, link: RoverLink, value: ParameterValue, rx_s: float) -> None:
        """Pass a value on; the same once more is not passed on."""
        key = (link.asset, value.name, link.kind)
        newest = self._newest.get(key)
        if newest == value:
            return
        late = newest is not None and value.timestamp < newest.timestamp
        if not late:
            self._newest[key] = value
        is_valid = value.validity is Validity.VALID and value.value is not None
        quality = Quality.GOOD if is_valid else Quality.INVALID
        self._sample(
            Sample(
                link.asset,
                value.name,
                link.kind,
                value.timestamp / NS_PER_S,
                rx_s,
                scalar_of(value.value) if is_valid else None,
                Quality.LATE if late else quality,
            )
        )

    def on_measured(self, link: RoverLink, figures: Mapping[str, float], rx_s: float) -> None:
        """Tell what was measured here of a link."""
        for key, value in figures.items():
            self._sample(Sample(link.asset, key, link.kind, rx_s, rx_s, value, Quality.GOOD))

    async def on_notification(
        self, link: RoverLink, notification: Notification, rx_s: float
    ) -> None:
        """Pass a notification on, with the id of the command that it is of."""
        said = notified(link.asset, link.kind, notification, rx_s)
        lost, left = given_up(notification), forwarded(notification)
        if (identity := lost or left) is not None:
            await self._commands.look_up(link.asset, identity)
            stage = GIVEN_UP if lost else FORWARDED
            said = replace(said, command=self._tracker.hear_orbiter(said, identity, stage))
        elif notification.source is not None and notification.commandId is not None:
            identity = Identity(notification.source, notification.commandId)
            await self._commands.look_up(link.asset, identity)
            said = replace(said, command=self._tracker.hear(said, identity))
        if notification.cursor is not None:
            known = LastNotification(notification.cursor, notification.timestamp // NS_PER_US)
            self._heard[link.asset, link.kind] = known
        self._publish(said)

    def on_status(self, link: RoverLink, status: AssetStatus) -> None:
        """Tell what an asset is about, if that is news."""
        if link.kind is LinkKind.DIRECT:  # an orbiter tells when it last heard of the rover
            self._forget_after(link, status.timestamp + AHEAD_NS)
        state = AssetState(
            link.asset,
            link.kind,
            status.timestamp / NS_PER_S,
            status.mode.name,
            None if status.activeCommandId is None else str(status.activeCommandId),
            status.queuedCommands,
            status.activePlan,
        )
        before = self._states.get((link.asset, link.kind))
        if before is None or replace(before, utc=state.utc) != state:
            self._states[link.asset, link.kind] = state
            self._publish(state)

    def on_authority(self, link: RoverLink, status: AuthorityStatus) -> None:
        """Pass on who may command."""
        self._desk.hear(link, status)

    def on_tree(self, link: RoverLink, snapshot: TreeSnapshot) -> None:
        """Pass a behaviour tree on."""
        self._tree(tree_of(link.asset, link.kind, snapshot))

    def on_plan(self, link: RoverLink, update: PlanUpdate) -> None:
        """Tell how far a plan is."""
        self._publish(
            PlanProgress(
                link.asset,
                update.planId,
                update.status.name,
                update.timestamp / NS_PER_S,
                update.node,
                update.done,
                update.total,
                update.text or "",
            )
        )

    def on_file(self, link: RoverLink, news: FileNotification) -> None:
        """Tell what happened to a file."""
        file = news.file
        self._publish(
            FileChanged(
                link.asset,
                link.heard_s or link.since_s,
                news.event.name,
                file.path,
                file.size,
                file.modified / NS_PER_S,
                file.mimeType,
            )
        )

    def on_services(self, _: RoverLink, services: tuple[ServiceDescriptor, ...]) -> None:
        """Connect with the assets that are registered there and cannot be reached directly."""
        for service in services:
            name, uri = service.name.removesuffix(_LAYER), service.providerURI
            asset = self.assets.get(name)
            direct = None if asset is None else asset.links.get(LinkKind.DIRECT)
            known = direct is not None and direct.state is not LinkState.DOWN
            known |= uri in {link.uri for link in self._running}
            if service.name.endswith(_LAYER) and not known:
                _LOG.info("%s is registered at %s", name, uri)
                self._run(RoverLink(uri, self._terms, self, self._system))

    async def last_known(self, link: RoverLink) -> LastNotification | None:
        """Return the last notification that was heard here, or else kept by a former run."""
        heard = self._heard.get((link.asset, link.kind))
        return heard or await self._last_known(link.asset, link.kind)

    def on_new_ledger(self, link: RoverLink) -> None:
        """Say that what was under way is not known any more."""
        _LOG.warning("%s came back with another ledger", link.asset)
        self._tracker.doubt_all(link.asset, "the asset came back without its ledger")

    def _forget_after(self, link: RoverLink, utc_ns: int) -> None:
        """Take no value for a late one because of those that were told with times after this."""
        this = (link.asset, link.kind)
        for key, newest in list(self._newest.items()):
            if key[::2] == this and newest.timestamp > utc_ns:
                del self._newest[key]

    def _run(self, link: RoverLink) -> None:
        self._running[link] = begin(link.run())


def notified(asset: str, link: LinkKind, notification: Notification, rx_s: float) -> Notified:
    """Return a notification as pages have it, of no command yet."""
    return Notified(
        asset=asset,
        link=link,
        sequence=notification.sequence,
        cursor=notification.cursor,
        utc=notification.timestamp / NS_PER_S,
        rx=rx_s,
        kind=notification.kind.name,
        severity=notification.severity.name,
        text=notification.text or "",
        command=None,
        stage=None if notification.stage is None else notification.stage.name,
        code=notification.code,
        step=notification.step,
        steps=notification.stepCount,
        figures=figures_of(notification.parameters),
    )


def tree_of(asset: str, link: LinkKind, snapshot: TreeSnapshot) -> TreeState:
    """Return a behaviour tree as pages have it."""
    return TreeState(
        asset=asset,
        link=link,
        utc=snapshot.utc_s,
        tick=snapshot.tick,
        mode=snapshot.mode,
        why=snapshot.why,
        active=None if snapshot.active is None else str(snapshot.active),
        faults=snapshot.faults,
        nodes=tuple(
            TreeNode(
                node.path,
                node.name,
                node.depth,
                node.kind.value,
                look.name.lower(),
                node.message,
                command,
            )
            for node, look, command in zip(
                snapshot.nodes, looks(snapshot.nodes), served(snapshot.nodes), strict=True
            )
        ),
    )


def figures_of(parameters: tuple[NamedValue, ...] | None) -> dict[str, Scalar]:
    """Return the figures of a notification."""
    return {each.name: scalar_of(each.value) for each in parameters or ()}


def scalar_of(value: TypedAttribute | None) -> Scalar:
    """Return a value that JSON can hold."""
    if value is None:
        return None
    found = value.value
    return found if isinstance(found, bool | int | float | str) else str(found)


def _settings_of(asset: str) -> Settings | None:
    if asset not in names_in(config_folder()):
        return None
    try:
        return load_settings(asset)
    except SettingsError as error:
        _LOG.warning("ranges of %s are not known here: %s", asset, error)
        return None
