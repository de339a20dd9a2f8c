"""`Fleet`: the connected assets with their links; converts their data into messages to pages."""

import asyncio
import logging
from collections.abc import Awaitable, Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

from adapters.console.archive import to_us
from adapters.console.command_states import FORWARDED, LOST, RECEIVED
from adapters.console.messages import (
    AssetState,
    Broadcast,
    DictionaryChanged,
    FileChanged,
    LinkKind,
    LinkState,
    LinkStatus,
    NotificationMessage,
    PlanProgress,
    PosePrediction,
    Quality,
    QuestionStatus,
    Sample,
    Scalar,
    TreeFault,
    TreeNode,
    TreeState,
)
from adapters.console.rovers.dictionary import (
    CONDITION_ENTRIES,
    NODE_ENTRIES,
    AssetEntry,
    command_entries,
    parameter_entries,
    zone_entries,
)
from adapters.console.rovers.operator_authority import OperatorAuthority
from adapters.console.rovers.pose_prediction import PREDICTION_S, PosePredictor
from adapters.console.rovers.rover_link import LINK_HOUSEKEEPING, LastNotification, RoverLink
from adapters.console.rovers.tracker import CommandTracker, SharedCommands
from adapters.console.tasks import cancel_tasks, start_task
from adapters.mal import NamedValue, TypedAttribute
from adapters.mrs.ground import FileNotification
from adapters.mrs.spec import (
    AssetStatus,
    AuthorityStatus,
    ParameterDefinition,
    ReceivedReport,
    ReceivedValue,
    ServiceDescriptor,
    forwarded_command,
    lost_command,
    notification_of,
)
from adapters.mrs.transport import TransportSettings
from adapters.system import System
from executive.settings import Settings, SettingsError, config_folder, load_settings, names_in
from executive.values.plan_nodes import PlanNodeReport
from executive.values.reports import Identity, PlanUpdate, ReportKind
from trees import TreeSnapshot, commands_by_node, display_statuses

_LOG: Final = logging.getLogger(__name__)

NS_PER_S: Final = 1e9
MAX_CLOCK_LEAD_S: Final = 2.0
"""Maximum lead of a value's stamp over the asset's clock; beyond it the clock was set back."""
_LAYER: Final = ".ServiceLayer"


@dataclass(slots=True)
class ConnectedAsset:
    """An asset that was reached.

    Attributes:
        settings: installed settings with its name; None if there are none.
        entry: its dictionary entry.
        predictor: predicts its pose.
        links: its links, by kind.
    """

    settings: Settings | None
    entry: AssetEntry
    predictor: PosePredictor
    links: dict[LinkKind, RoverLink] = field(default_factory=dict)

    def best_link(self) -> RoverLink | None:
        """Return the fastest link that is up; None if none is up."""
        found = [self.links[kind] for kind in LinkKind if kind in self.links]
        return next((link for link in found if link.state is LinkState.UP), None)


class Fleet:
    """Runs links to all addresses and to the assets registered there; is their `LinkListener`.

    Args:
        uris: the addresses.
        terms: transport settings of all links.
        publish: publishes a message.
        sample: publishes a telemetry value.
        tree: publishes a behaviour tree.
        prediction: publishes a predicted pose.
        last_known: returns the last archived notification of an asset and link.
        tracker: tracks the states of commands.
        commands: commands of all consoles.
        desk: holders of the authority.
        system: clock and network.
    """

    def __init__(
        self,
        uris: Iterable[str],
        terms: TransportSettings,
        publish: Callable[[Broadcast], None],
        sample: Callable[[Sample], None],
        tree: Callable[[TreeState], None],
        prediction: Callable[[PosePrediction], None],
        last_known: Callable[[str, LinkKind], Awaitable[LastNotification | None]],
        tracker: CommandTracker,
        commands: SharedCommands,
        desk: OperatorAuthority,
        system: System,
    ) -> None:
        self._terms, self._system = terms, system
        self._publish = publish
        self._sample = sample
        self._tree, self._prediction = tree, prediction
        self._predicting: asyncio.Task[None] | None = None
        self._last_known = last_known
        self._tracker, self._commands, self._desk = tracker, commands, desk
        self._links = [RoverLink(uri, terms, self, system) for uri in uris]
        self._running: dict[RoverLink, asyncio.Task[None]] = {}
        self.assets: dict[str, ConnectedAsset] = {}
        self._newest: dict[tuple[str, str, LinkKind], ReceivedValue] = {}
        self._questions: dict[tuple[str, str, str], QuestionStatus] = {}
        self._states: dict[tuple[str, LinkKind], AssetState] = {}
        self._last_received: dict[tuple[str, LinkKind], LastNotification] = {}

    def start(self) -> None:
        """Start all links."""
        for link in self._links:
            self._run(link)
        self._predicting = start_task(self._predict())

    async def close(self) -> None:
        """Close all links."""
        await cancel_tasks(
            [*self._running.values(), *([self._predicting] if self._predicting else [])]
        )
        for asset in self.assets.values():
            asset.predictor.close()

    def entries(self) -> Iterator[AssetEntry]:
        """Yield the dictionary entry of each reached asset."""
        return (asset.entry for asset in self.assets.values())

    def video_of(self, asset: str) -> tuple[str, int] | None:
        """Return the video address of an asset's settings; None if unknown."""
        known = self.assets.get(asset)
        if known is None or known.settings is None or known.settings.video is None:
            return None
        return known.settings.video.to_host, known.settings.video.to_port

    def on_asset(self, link: RoverLink, definitions: tuple[ParameterDefinition, ...]) -> None:
        """Store a reached asset, and publish a change of its dictionary entry."""
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
            frame=None if settings is None else settings.frame,
            takers=_takers_of(settings, link),
            nodes=NODE_ENTRIES,
            conditions=CONDITION_ENTRIES,
        )
        if known is None:
            known = self.assets[name] = ConnectedAsset(settings, entry, PosePredictor(settings))
        former = known.links.get(link.kind, link)
        known.links[link.kind] = link
        if former is not link and former not in self._links and former.state is LinkState.DOWN:
            self._running.pop(former).cancel()  # the asset has moved to this address
        self._forget_after(link, 0)  # its clock may have been set back
        if known.entry != entry or len(known.links) == 1:
            known.entry = entry
            self._publish(DictionaryChanged(name))

    def on_state(self, link: RoverLink) -> None:
        """Publish the status of a link, unless another address has replaced it."""
        known = self.assets.get(link.asset)
        if known is not None:
            if known.links.get(link.kind) is not link:
                return
            self._tracker.on_links(link.asset, are_lost=known.best_link() is None)
        status = (link.uri, link.state, link.since_s, link.last_received_s, link.detail)
        offered = link.delay.declared_s, link.preconditions
        self._publish(LinkStatus(link.asset, link.kind, *status, *offered))

    def on_value(self, link: RoverLink, value: ReceivedValue, rx_s: float) -> None:
        """Publish a value, unless it repeats the previous one."""
        key = (link.asset, value.name, link.kind)
        newest = self._newest.get(key)
        if newest == value:
            return
        late = newest is not None and value.utc_s < newest.utc_s
        if not late:
            self._newest[key] = value
        quality = Quality.INVALID if value.value is None else Quality.GOOD
        figure = (value.utc_s, rx_s, value.value, Quality.LATE if late else quality)
        self._sample(Sample(link.asset, value.name, link.kind, *figure))
        if not late and (known := self.assets.get(link.asset)) is not None:
            known.predictor.on_value(value)

    def on_measured(self, link: RoverLink, figures: Mapping[str, float], rx_s: float) -> None:
        """Publish figures that the console measured of a link."""
        for key, value in figures.items():
            self._sample(Sample(link.asset, key, link.kind, rx_s, rx_s, value, Quality.GOOD))

    async def on_notification(self, link: RoverLink, received: ReceivedReport, rx_s: float) -> None:
        """Publish a report with the id of its command."""
        report = received.report
        if (known := self.assets.get(link.asset)) is not None:
            known.predictor.on_report(report)
        message = notification_message(link.asset, link.kind, received, rx_s)
        lost, left = lost_command(report), forwarded_command(report)
        if (identity := lost or left) is not None:
            await self._commands.load_foreign(link.asset, identity)
            stage = LOST if lost else FORWARDED
            message = replace(
                message, command=self._tracker.on_orbiter_notification(message, identity, stage)
            )
        elif (identity := report.identity) is not None and report.kind is not ReportKind.LINK:
            await self._commands.load_foreign(link.asset, identity)
            name = self._tracker.on_notification(message, identity)
            message = replace(message, command=name)
            command = self._tracker.get(name)  # None: dropped, for too many are open
            is_first = message.stage == RECEIVED and link.kind is LinkKind.DIRECT
            if is_first and command is not None and command.args is None:
                link.request_arguments(identity)
        if received.cursor:
            last = LastNotification(received.cursor, to_us(report.utc_s))
            self._last_received[link.asset, link.kind] = last
        self._publish(message)

    def on_status(self, link: RoverLink, status: AssetStatus) -> None:
        """Publish mode and work of an asset, if changed."""
        if link.kind is LinkKind.DIRECT:  # an orbiter stamps its last contact with the rover
            self._forget_after(link, status.timestamp / NS_PER_S + MAX_CLOCK_LEAD_S)
            if status.activeCommandId is not None:
                self._tracker.on_active(link.asset, status.activeCommandId)
        if (known := self.assets.get(link.asset)) is not None:
            known.predictor.on_status(status)
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
        """Pass the authority status on."""
        self._desk.on_status(link, status)

    def on_tree(self, link: RoverLink, snapshot: TreeSnapshot) -> None:
        """Publish a behaviour tree."""
        self._tree(tree_of(link.asset, link.kind, snapshot))

    def on_plan(self, link: RoverLink, update: PlanUpdate) -> None:
        """Publish the progress of a plan."""
        self._publish(plan_progress(link.asset, update))

    def on_plan_nodes(
        self, link: RoverLink, plan_id: str, nodes: tuple[PlanNodeReport, ...]
    ) -> None:
        """Publish the begin and the end of each question of a plan."""
        known = self.assets.get(link.asset)
        if known is None or known.best_link() is not link:
            return
        ended = {each.path: each.decision for each in nodes}
        found = {
            (link.asset, plan_id, each.key): QuestionStatus(
                *(link.asset, plan_id, each.key, each.text, each.options),
                *(each.default, each.until_utc_s),
            )
            for node in nodes
            if (each := node.question) is not None
        }
        for key, question in tuple(self._questions.items()):
            if key[:2] == (link.asset, plan_id) and key not in found:
                del self._questions[key]
                self._publish(replace(question, end=ended.get(question.question, "")))
        for key, question in found.items():
            if self._questions.get(key) != question:
                self._questions[key] = question
                self._publish(question)

    def on_file(self, link: RoverLink, notification: FileNotification) -> None:
        """Publish a change of a file."""
        file = notification.file
        self._publish(
            FileChanged(
                link.asset,
                link.last_received_s or link.since_s,
                notification.event.name,
                file.path,
                file.size,
                file.modified / NS_PER_S,
                file.mimeType,
            )
        )

    def on_services(self, _: RoverLink, services: tuple[ServiceDescriptor, ...]) -> None:
        """Connect to registered assets without a direct link."""
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
        """Return the last notification received by this process, else the last archived one."""
        received = self._last_received.get((link.asset, link.kind))
        return received or await self._last_known(link.asset, link.kind)

    def on_arguments(self, link: RoverLink, identity: Identity, args: dict[str, Any]) -> None:
        """Publish the arguments of a command of another client."""
        self._tracker.add_arguments(link.asset, identity, args)

    def on_new_ledger(self, link: RoverLink) -> None:
        """Mark the open commands of an asset UNKNOWN."""
        _LOG.warning("%s restarted with another ledger", link.asset)
        self._tracker.mark_all_unknown(link.asset, "the asset restarted without its ledger")

    def _forget_after(self, link: RoverLink, utc_s: float) -> None:
        """Discard newest values with later stamps, so that new values do not count as late."""
        this = (link.asset, link.kind)
        for key, newest in list(self._newest.items()):
            if key[::2] == this and newest.utc_s > utc_s:
                del self._newest[key]

    async def _predict(self) -> None:
        """Publish where the next commands find the assets, each second."""
        while True:
            for asset in tuple(self.assets.values()):
                found = await asset.predictor.predict(asset.best_link(), self._system.utc_s())
                if found is not None:
                    self._prediction(found)
            await asyncio.sleep(PREDICTION_S)

    def _run(self, link: RoverLink) -> None:
        self._running[link] = start_task(link.run())


def _takers_of(settings: Settings | None, link: RoverLink) -> tuple[str, ...] | None:
    """Return the operators that may take the authority over a link; None for all or if unknown."""
    if settings is None:
        return None
    sources = settings.authority.takeover_sources
    if link.proven_name is None:
        return sources
    return None if link.proven_name in sources else ()


def notification_message(
    asset: str, link: LinkKind, received: ReceivedReport, rx_s: float
) -> NotificationMessage:
    """Return a report as a console message, without a command id."""
    notification = notification_of(received.report, received.cursor)
    return NotificationMessage(
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
        fault=notification.fault,
    )


def plan_progress(asset: str, update: PlanUpdate) -> PlanProgress:
    """Return the progress of a plan as a console message."""
    return PlanProgress(
        asset,
        update.plan_id,
        update.status.name,
        update.utc_s,
        update.node or None,
        update.done,
        update.total,
        update.text,
    )


def tree_of(asset: str, link: LinkKind, snapshot: TreeSnapshot) -> TreeState:
    """Return a behaviour tree as a console message."""
    return TreeState(
        asset=asset,
        link=link,
        utc=snapshot.utc_s,
        tick=snapshot.tick,
        mode=snapshot.mode,
        why=snapshot.why,
        active=None if snapshot.active is None else str(snapshot.active),
        faults=tuple(
            TreeFault(each.name, each.severity.name, each.text) for each in snapshot.faults
        ),
        nodes=tuple(
            TreeNode(
                node.path,
                node.name,
                node.depth,
                node.kind.value,
                status.name.lower(),
                node.message,
                command,
            )
            for node, status, command in zip(
                snapshot.nodes,
                display_statuses(snapshot.nodes),
                commands_by_node(snapshot.nodes),
                strict=True,
            )
        ),
    )


def figures_of(parameters: tuple[NamedValue, ...] | None) -> dict[str, Scalar]:
    """Return the figures of a notification by name."""
    return {each.name: scalar_of(each.value) for each in parameters or ()}


def scalar_of(value: TypedAttribute | None) -> Scalar:
    """Return a MAL attribute as a JSON scalar."""
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
        _LOG.warning("settings of %s cannot be read, its ranges are unknown: %s", asset, error)
        return None
