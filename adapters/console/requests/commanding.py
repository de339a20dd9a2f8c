"""`Commanding` sends commands and preview requests of operators to assets; `stops` sends stops.

The asset decides on the authority: a command claims the epoch that its operator holds there.
"""

import asyncio
import logging
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any, Final, TypeVar, get_args

from adapters.console.archive import ArchiveError
from adapters.console.command_states import ORBITER
from adapters.console.messages import CommandStatus, LinkKind, LinkState
from adapters.console.requests.stops import STOP, Stops
from adapters.console.rovers import (
    CommandTracker,
    ConnectedAsset,
    Fleet,
    InvalidArgument,
    OperatorAuthority,
    RoverLink,
    SharedCommands,
    request_of,
    sent_status,
)
from adapters.console.tasks import start_task
from adapters.console.web import invalid, is_number, one_of, refused
from adapters.mal import MalError, StandardError
from adapters.mrs.ground import CommandIdGenerator, MrsClient
from adapters.mrs.spec import AreaError, PlanPreview, Preview, describe_error
from executive.commands import (
    Command,
    Motion,
    PlanDefinition,
    Precondition,
    PreemptionPolicy,
    Request,
)
from executive.settings import Settings

T = TypeVar("T")

_LOG: Final = logging.getLogger(__name__)

MAX_ID_LENGTH: Final = 64
MAX_LIFETIME_S: Final = 7 * 86_400.0
QUERY_TIMEOUT_S: Final = 60.0
"""Timeout of a query, also of a preview, s."""
_REFUSED: Final = HTTPStatus.UNPROCESSABLE_ENTITY
_REFUSALS: Final = {error.value for error in AreaError}


@dataclass(frozen=True, slots=True)
class CommandPost:
    """A command that a page posts.

    Attributes:
        id: created by the page; a repeated id is not sent a second time.
        link: link to send it over; None for the fastest link.
        lifetime_s: lifetime of the command; None for unlimited.
        precondition: condition of its execution; None for none.
    """

    id: str
    asset: str
    name: str
    args: object
    link: LinkKind | None = None
    preemption: PreemptionPolicy = PreemptionPolicy.APPEND
    lifetime_s: float | None = None
    precondition: Precondition | None = None


def parse_command_post(body: dict[str, Any]) -> CommandPost:
    """Return the command of a body.

    Raises:
        RequestError: a field is invalid.
    """
    try:
        precondition = Precondition.from_wire(body.get("only_at"), body.get("only_after"))
    except (TypeError, ValueError) as error:
        raise invalid("only_at, only_after", str(error)) from error
    return CommandPost(
        id=identifier(body.get("id")),
        asset=str(body.get("asset")),
        name=str(body.get("name")),
        args=body.get("args", {}),
        link=None if body.get("link") is None else one_of(LinkKind, "link", body["link"]),
        preemption=one_of(
            PreemptionPolicy, "preemption", body.get("preemption", PreemptionPolicy.APPEND.value)
        ),
        lifetime_s=_lifetime(body.get("lifetime")),
        precondition=precondition,
    )


class Commanding:
    """Sends commands, stops and preview requests of operators.

    Args:
        fleet: the assets.
        tracker: tracks the states of commands.
        commands: commands of all consoles.
        desk: holders of the authority.
        numbers: command ids: one sequence for all links of an asset.
        stops: sends the stops.
    """

    def __init__(
        self,
        fleet: Fleet,
        tracker: CommandTracker,
        commands: SharedCommands,
        desk: OperatorAuthority,
        numbers: CommandIdGenerator,
        stops: Stops,
    ) -> None:
        self._fleet, self._tracker, self._desk, self._stops = fleet, tracker, desk, stops
        self._commands, self._numbers = commands, numbers
        self._sending: set[asyncio.Task[None]] = set()

    async def post(self, operator: str, posted: CommandPost) -> CommandStatus:
        """Send a command; return its status, SENDING.

        Raises:
            RequestError: it is not sent.
        """
        if posted.name == STOP:  # sent without any check
            return self.stop(operator, posted.asset)
        return await self.send(
            operator,
            posted,
            lambda: self._request(self._asset(posted.asset), posted.name, posted.args),
        )

    async def send(
        self, operator: str, posted: CommandPost, make: Callable[[], Request]
    ) -> CommandStatus:
        """Send a command; return its status, SENDING.

        Args:
            operator: sending operator.
            posted: posted command.
            make: returns its request, or raises RequestError.

        Raises:
            RequestError: it is not sent.
        """
        if (known := self._tracker.get(posted.id)) is not None:
            raise _duplicate_post(known)
        request = make()
        link = self.link(posted.asset, posted.link)
        client = self._desk.client(link)
        claimed = False
        while not claimed:
            command = client.command(
                request,
                source=self._desk.source(link, operator),
                command_id=self._numbers.next_id(),
                lifetime_s=posted.lifetime_s,
                preemption=posted.preemption,
                precondition=posted.precondition,
                authority=self._desk.claim(link, operator),
            )
            args = posted.args if isinstance(posted.args, dict) else {}
            status = sent_status(
                *(posted.id, posted.asset, operator, link.kind, command, args),
                round_trip_s=link.delay.declared_s,
            )
            claimed = await self._claim(status)
        _LOG.info("%s %s: %s of %s", posted.asset, command.identity, posted.name, operator)
        self._tracker.register(status)
        self._asset(posted.asset).predictor.on_sent(command, status.created)
        self._send(client, link, status.id, command)
        return status

    def stop(self, operator: str, asset: str, age_s: float = 0.0) -> CommandStatus:
        """Stop an asset, over any link and without the authority; see `Stops.send`.

        Raises:
            RequestError: it is unknown.
        """
        return self._stops.send(operator, self._asset(asset), age_s)

    async def preview(self, name: str, motion: str, args: object) -> Preview:
        """Return the preview of a motion.

        Raises:
            RequestError: the motion would be refused, or the preview is not available.
        """
        asset = self._asset(name)
        request = self._request(asset, motion, args)
        if not isinstance(request, get_args(Motion)):
            text = f"{motion} is no motion: it has no preview"
            raise refused(HTTPStatus.UNPROCESSABLE_ENTITY, text, field="name")
        return await self.query(name, lambda client: client.preview(request), _REFUSED)

    async def preview_plan(self, asset: str, plan: PlanDefinition) -> PlanPreview:
        """Return the preview of a plan and of its steps.

        Raises:
            RequestError: the preview is not available.
        """
        return await self.query(asset, lambda client: client.preview_steps(plan), _REFUSED)

    async def query(
        self,
        asset: str,
        request: Callable[[MrsClient], Awaitable[T]],
        refusal: HTTPStatus = HTTPStatus.NOT_IMPLEMENTED,
        timeout_s: float = QUERY_TIMEOUT_S,
    ) -> T:
        """Return the answer of an asset to a query.

        Raises:
            RequestError: the asset refuses the query, with the status `refusal`; or it cannot be
                reached, or does not answer in time.
        """
        try:
            link = self.link(asset, None)
            async with asyncio.timeout(timeout_s + link.delay.declared_s):
                return await request(self._desk.client(link))
        except MalError as error:
            late = error.number == StandardError.DELIVERY_TIMEDOUT.value
            status = HTTPStatus.SERVICE_UNAVAILABLE if late else refusal
            raise refused(status, describe_error(error)) from error
        except (ConnectionError, TimeoutError) as error:
            text = f"{asset} cannot be reached or does not answer: try again when its link is up"
            raise refused(HTTPStatus.SERVICE_UNAVAILABLE, text) from error

    def client(self, asset: str) -> MrsClient:
        """Return the session with an asset over its fastest link.

        Raises:
            RequestError: there is no link, or it is down.
        """
        return self._desk.client(self.link(asset, None))

    def settings(self, asset: str) -> Settings | None:
        """Return the installed settings of an asset; None if there are none.

        Raises:
            RequestError: the asset is unknown.
        """
        return self._asset(asset).settings

    def file_client(self, asset: str) -> MrsClient:
        """Return the session for files of an asset, over the direct link only.

        Raises:
            RequestError: there is no direct link, or it is down.
        """
        known = self._asset(asset)
        if LinkKind.DIRECT not in known.links:
            text = (
                f"files of {asset} need its direct link, which is not configured: the orbiter"
                " does not forward files; give the rover's address with --to"
            )
            raise refused(HTTPStatus.SERVICE_UNAVAILABLE, text)
        return self._desk.client(self._link(known, LinkKind.DIRECT))

    async def identity(self, name: str) -> str:
        """Return SOURCE:NUMBER of a command by its id; an unknown id is returned unchanged."""
        known = await self._commands.find(name)
        return name if known is None else f"{known.source}:{known.number}"

    async def close(self) -> None:
        """Wait up to 1 s for commands that are being sent, then cancel them."""
        if self._sending:
            await asyncio.wait(self._sending, timeout=1.0)
        for task in self._sending:
            task.cancel()

    async def _claim(self, status: CommandStatus) -> bool:
        """Claim a command for this console; return False if its number is already used.

        Raises:
            RequestError: its id was posted before, or the archive cannot be written.
        """
        try:
            if await self._commands.claim(status):
                return True
        except ArchiveError as error:
            text = f"{error}: nothing was sent; free disk space, then post it again"
            raise refused(HTTPStatus.SERVICE_UNAVAILABLE, text) from error
        known = await self._commands.find(status.id)
        if known is not None:
            raise _duplicate_post(known)
        return False

    def _asset(self, name: str) -> ConnectedAsset:
        asset = self._fleet.assets.get(name)
        if asset is None:
            known = ", ".join(self._fleet.assets) or "none reached yet"
            text = f"asset: {name[:64]!r} is unknown; known assets: {known}"
            raise refused(HTTPStatus.NOT_FOUND, text, field="asset")
        return asset

    def _request(self, asset: ConnectedAsset, name: str, args: object) -> Request:
        form = next((each for each in asset.entry.commands if each.name == name), None)
        if form is None:
            text = f"command {name[:64]!r} is unknown; the dictionary lists the commands"
            raise invalid("name", text)
        request = request_of(form, args)
        if isinstance(request, InvalidArgument):
            raise refused(
                HTTPStatus.UNPROCESSABLE_ENTITY,
                request.text,
                field=request.field,
                low=request.low,
                high=request.high,
                choices=request.choices,
            )
        return request

    def link(self, asset: str, wanted: LinkKind | None) -> RoverLink:
        """Return the wanted link to an asset; None selects the fastest.

        Raises:
            RequestError: there is no such link, or it is not up.
        """
        return self._link(self._asset(asset), wanted)

    def _link(self, asset: ConnectedAsset, wanted: LinkKind | None) -> RoverLink:
        link = asset.best_link() if wanted is None else asset.links.get(wanted)
        if link is None or link.state is not LinkState.UP or link.client is None:
            by = "" if wanted is None else f" by the {wanted.value} link"
            text = f"{asset.entry.asset} cannot be reached{by}: nothing was sent"
            raise refused(HTTPStatus.SERVICE_UNAVAILABLE, f"{text}; try again when its link is up")
        return link

    def _send(self, client: MrsClient, link: RoverLink, name: str, command: Command) -> None:
        task = start_task(self._submit(client, link, name, command))
        self._sending.add(task)
        task.add_done_callback(self._sending.discard)

    async def _submit(
        self, client: MrsClient, link: RoverLink, name: str, command: Command
    ) -> None:
        node = ORBITER if link.kind is LinkKind.RELAY else link.asset
        try:
            await client.submit(command)
        except MalError as error:
            if error.number in _REFUSALS:
                self._tracker.on_rejected(name, node, describe_error(error))
            else:
                self._tracker.mark_unknown(name, f"no valid answer: {describe_error(error)}")
        except ConnectionError as error:
            self._tracker.mark_unknown(name, f"the link was lost before the answer: {error}")
        else:
            self._tracker.on_acknowledged(name, node)


def _duplicate_post(known: CommandStatus) -> Exception:
    text = f"{known.id} was posted before and is not sent again: `command` has its status"
    return refused(HTTPStatus.CONFLICT, text, command=known)


def identifier(value: object) -> str:
    """Return the id of a command.

    Raises:
        RequestError: it is invalid.
    """
    if not isinstance(value, str) or not 0 < len(value) <= MAX_ID_LENGTH or not value.isprintable():
        text = f"1 to {MAX_ID_LENGTH} printable characters are needed, new for each command"
        raise invalid("id", text)
    return value


def _lifetime(value: object) -> float | None:
    if value is None:
        return None
    if not is_number(value) or not 0 < value <= MAX_LIFETIME_S:
        text = f"seconds above 0 and at most {MAX_LIFETIME_S:g} are needed"
        raise invalid("lifetime", text, low=0.0, high=MAX_LIFETIME_S)
    return float(value)
