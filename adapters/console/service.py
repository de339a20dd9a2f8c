"""`serve`, the body of `rover-console`: assembles archive, links and HTTP; runs until a signal."""

import asyncio
import shutil
import ssl
from collections.abc import AsyncIterator, Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from http import HTTPStatus
from itertools import chain
from pathlib import Path
from typing import Final

import click
from aiohttp import web
from sqlalchemy.exc import SQLAlchemyError

from adapters.console.archive import (
    Archive,
    RetentionPolicy,
    last_notification,
    open_database,
    run_retention,
)
from adapters.console.housekeeping import ASSET, ConsoleHousekeeping
from adapters.console.messages import (
    Broadcast,
    LinkKind,
    LinkStatus,
    NotificationMessage,
    Sample,
    TreeState,
)
from adapters.console.metrics import metrics_routes
from adapters.console.recordings import Recordings
from adapters.console.requests import (
    AlarmRequests,
    ArchiveRequests,
    Commanding,
    DraftRequests,
    ExplanationRequests,
    ExportRequests,
    FileRequests,
    FileStore,
    ForkRequests,
    MapRequests,
    OperationRequests,
    PlanCheckRequests,
    PlanRequests,
    SharedObjectRequests,
    Stops,
    Transfers,
    VideoRequests,
)
from adapters.console.rovers import (
    AssetEntry,
    CommandTracker,
    Fleet,
    LastNotification,
    OperatorAuthority,
    ParameterEntry,
    SharedCommands,
)
from adapters.console.tasks import cancel_tasks, start_task
from adapters.console.web import (
    MAX_BODY_OCTETS,
    MAX_REPLAYED_COMMANDS,
    Access,
    Handler,
    Hub,
    SharedPresence,
    Sockets,
    error_middleware,
    help_routes,
    json_response,
    page_routes,
    read_tokens,
    refused,
)
from adapters.mal import CertificateError, address_to_listen, is_loopback
from adapters.mrs.cli import RoverTarget
from adapters.mrs.ground import CommandIdGenerator, parse_address
from adapters.process import StartError, exclusive, termination_event
from adapters.recording import RecordingError
from adapters.system import System
from executive.settings import shipped_folder

STATIC: Final = Path(__file__).parent / "static"
_TEXTS: Final = {"application/json", "text/html", "text/javascript"}
_CONDITIONS: Final = ("If-None-Match", "If-Modified-Since")
READ_RETRY_S: Final = 1.0
"""Retry interval for reads of the archive that must succeed, s."""
LOCK: Final = "console.lock"
FILES: Final = "files"
"""Subfolder of the data folder for files of assets."""
OPENED: Final = "opened"
"""Subfolder for opened recordings; emptied at each start."""


def _application(
    hub: Hub,
    entries: Callable[[], Iterable[AssetEntry]],
    own: AssetEntry,
    access: Access,
    routes: Sequence[web.RouteDef],
) -> web.Application:
    """Return the application that serves pages and the HTTP interface."""

    async def health(_: web.Request) -> web.Response:
        return json_response({"instance": hub.instance})

    async def dictionary(_: web.Request) -> web.Response:
        return json_response({"assets": {each.asset: each for each in entries()}, "console": own})

    application = web.Application(
        middlewares=[error_middleware, access.middleware, _compressed],
        client_max_size=MAX_BODY_OCTETS,
    )
    sockets = Sockets(hub, access)
    application.on_shutdown.append(sockets.close)
    application.add_routes(
        [
            web.get("/healthz", health),
            web.post("/api/login", access.login),
            web.get("/api/dictionary", dictionary),
            *routes,
            web.get("/ws", sockets.serve),
            web.get("/api/{rest:.*}", _empty_response),
            *page_routes(STATIC, access),
            web.static("/", STATIC, append_version=False),
        ]
    )
    return application


@web.middleware
async def _compressed(request: web.Request, handler: Handler) -> web.StreamResponse:
    """Compress pages and JSON if the client accepts it; compressed files are sent unchanged.

    Responses to conditional requests and to HEAD are not compressed: aiohttp would send the end of
    a compressed body where there is none, and the browser would read that as the next response.
    """
    response = await handler(request)
    is_conditional = any(name in request.headers for name in _CONDITIONS)
    is_file = isinstance(response, web.FileResponse) and not request.path.startswith("/api/")
    is_whole_file = is_file and not is_conditional
    is_text = isinstance(response, web.Response) and response.content_type in _TEXTS
    if not response.prepared and (is_whole_file or is_text) and request.method != "HEAD":
        response.enable_compression()
    return response


async def _empty_response(request: web.Request) -> web.Response:
    text = f"there is no {request.path}: see docs/console.md"
    raise refused(HTTPStatus.NOT_FOUND, text)


@dataclass(frozen=True, slots=True)
class ConsoleOptions:
    """Options of the command line.

    Attributes:
        to: the rovers.
        host, port: address of the console; port 0 for any free port.
        tokens: file of the operators who may log in.
        tls: certificate and key, for HTTPS.
        data: folder for persistent data.
        archive: URL of the database; None for a file in the folder.
        retention: bounds of the archived data.
        video: UDP addresses for the video of assets; other assets use their settings.
        recordings: files that are opened at the start.
    """

    to: tuple[RoverTarget, ...]
    host: str
    port: int
    tokens: Path | None
    tls: tuple[Path, Path] | None
    data: Path
    archive: str | None = None
    retention: RetentionPolicy = field(default_factory=RetentionPolicy)
    video: Mapping[str, tuple[str, int]] = field(default_factory=dict)
    recordings: tuple[Path, ...] = ()


async def serve(options: ConsoleOptions, system: System) -> None:
    """Serve until SIGINT or SIGTERM.

    Raises:
        StartError: it cannot start.
    """
    ended = termination_event()
    async with running(options, system) as address:
        click.echo(address)
        await ended.wait()


@asynccontextmanager
async def running(options: ConsoleOptions, system: System) -> AsyncIterator[str]:
    """Serve within the context; yields the address for a browser.

    Raises:
        StartError: it cannot start.
    """
    try:
        options = replace(options, host=address_to_listen(options.host))
    except OSError as error:
        raise StartError(f"--host {options.host}: {error.strerror}") from error
    access, context = _access(options)
    with exclusive(options.data, LOCK):
        engine = open_database(options.archive, options.data, system)
        archive = Archive(engine, system.utc_s)
        try:
            async with _serving(options, archive, access, context, system) as address:
                yield address
        finally:
            await archive.close()


@asynccontextmanager
async def _serving(
    options: ConsoleOptions,
    archive: Archive,
    access: Access,
    context: ssl.SSLContext | None,
    system: System,
) -> AsyncIterator[str]:
    hub = Hub(system)

    def publish(message: Broadcast) -> None:
        hub.publish(message)
        archive.put(message)
        if isinstance(message, NotificationMessage):
            alarms.on_report(message)
        elif isinstance(message, LinkStatus):
            alarms.on_link(message)

    def sample(value: Sample) -> None:
        hub.sample(value)
        archive.put(value)
        alarms.on_sample(value)

    def tree(state: TreeState) -> None:
        hub.state(state)
        archive.put_tree(state)
        alarms.on_tree(state)

    def parameter_of(asset: str, key: str) -> ParameterEntry | None:
        known = fleet.assets.get(asset)
        entry = housekeeping.entry if known is None else known.entry
        return entry.parameter(key) if entry.asset == asset else None

    async def last_known(asset: str, link: LinkKind) -> LastNotification | None:
        last = partial(last_notification, asset=asset, link=link)
        while True:
            with suppress(SQLAlchemyError):  # retried: without it missed notifications are unknown
                found = await archive.read(last)
                return None if found is None else LastNotification(*found)
            await asyncio.sleep(READ_RETRY_S)

    tracker = CommandTracker(publish, system.utc_s)
    commands = SharedCommands(archive, tracker)
    await commands.restore(MAX_REPLAYED_COMMANDS)
    desk = OperatorAuthority(publish, hub.is_present, system.utc_s)
    uris = [_uri(target) for target in options.to]
    try:
        fleet = Fleet(
            *(uris, options.to[0].terms, publish, sample, tree, hub.state),
            *(last_known, tracker, commands, desk, system),
        )
    except CertificateError as error:
        raise StartError(f"TLS: {error}") from error
    housekeeping = ConsoleHousekeeping(archive, hub, options.data, sample, system)
    alarms = AlarmRequests(archive, publish, parameter_of)
    numbers = CommandIdGenerator(system)
    stops = Stops(tracker, desk, numbers, publish, system.utc_s)
    commanding = Commanding(fleet, tracker, commands, desk, numbers, stops)
    store = FileStore(options.data / FILES)
    transfers = Transfers(commanding.file_client, store, hub.transfer, system)
    recordings = Recordings(_empty_folder(options.data / OPENED), publish, system.utc_s)
    objects = SharedObjectRequests(archive, publish)
    presence = SharedPresence(archive, hub, asyncio.get_running_loop().time)

    def entries() -> Iterator[AssetEntry]:
        return chain(fleet.entries(), recordings.entries())

    routes = [
        *OperationRequests(commanding, stops, desk).routes(),
        *DraftRequests(commanding).routes(),
        *PlanCheckRequests(commanding).routes(),
        *PlanRequests(commanding, archive).routes(),
        *ExplanationRequests(commanding, recordings).routes(),
        *MapRequests(commanding).routes(),
        *FileRequests(commanding.file_client, store, transfers, recordings, ASSET).routes(),
        *VideoRequests(options.video, fleet.video_of, system.utc_s).routes(),
        *recordings.routes(),
        *ForkRequests(recordings).routes(),
        *ArchiveRequests(archive, recordings).routes(),
        *ExportRequests(archive, recordings, lambda: (*entries(), housekeeping.entry)).routes(),
        *objects.routes(),
        *alarms.routes(),
        *metrics_routes(fleet, archive, housekeeping, options.data, system),
        *help_routes(shipped_folder("docs")),
    ]
    runner = web.AppRunner(
        _application(hub, entries, housekeeping.entry, access, routes),
        access_log=None,
        shutdown_timeout=1.0,
    )
    await runner.setup()
    site = web.TCPSite(runner, options.host, options.port, ssl_context=context)
    working = [
        archive.run(),
        tracker.run(),
        desk.run(),
        alarms.run(),
        housekeeping.run(),
        commands.run(),
        objects.run(),
        presence.run(),
        run_retention(archive, options.retention),
    ]
    tasks = [start_task(each) for each in working]
    try:
        try:
            for path in options.recordings:
                await recordings.open(path)
            await site.start()
        except RecordingError as error:
            raise StartError(f"--recording: {error}") from error
        except OSError as error:
            raise StartError(
                f"{options.host}:{options.port} cannot be served ({error.strerror}): stop the"
                " process at this port, or choose another with --port"
            ) from error
        fleet.start()
        transfers.start()
        yield _address(options, runner)
    finally:
        await stops.close()
        await commanding.close()
        await transfers.close()
        await cancel_tasks(tasks)
        await fleet.close()
        await alarms.close()
        await presence.close()
        await runner.cleanup()
        await recordings.close()


def _access(options: ConsoleOptions) -> tuple[Access, ssl.SSLContext | None]:
    """Return the access control, and the TLS context for HTTPS."""
    if not is_loopback(options.host) and (options.tokens is None or options.tls is None):
        raise StartError(
            f"other hosts can reach {options.host}: give --tokens FILE (lines NAME TOKEN) for"
            " login, and --tls-certificate PEM --tls-key PEM for HTTPS; or omit --host and use a"
            " tunnel such as `ssh -L`"
        )
    context = None
    if options.tls is not None:
        certificate, key = options.tls
        context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
        try:
            context.load_cert_chain(certificate, key)
        except (OSError, ssl.SSLError) as error:
            raise StartError(f"{certificate} with {key} cannot be used: {error}") from error
    tokens = None if options.tokens is None else read_tokens(options.tokens)
    now_s = asyncio.get_running_loop().time
    return Access(tokens, context is not None, now_s), context


def _empty_folder(folder: Path) -> Path:
    """Return the folder, emptied of data from former runs."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    return folder


def _uri(target: RoverTarget) -> str:
    try:
        return str(parse_address(target.uri))
    except ValueError as error:
        raise click.UsageError(f"--to: {error}") from error


def _address(options: ConsoleOptions, runner: web.AppRunner) -> str:
    port = runner.addresses[0][1]
    host = f"[{options.host}]" if ":" in options.host else options.host
    return f"{'http' if options.tls is None else 'https'}://{host}:{port}/"
