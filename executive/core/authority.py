"""`Authority` lets one operator at a time command the asset (thesis 3.1).

The holder has a lease, which each of its contacts renews. The authority passes on by
hand-over, release, expiry of the lease, or takeover by a source that the settings permit. Each
grant has an epoch: a strictly increasing number that is committed to the ledger before any reply.
Commands carry it as a fencing token, so that commands of a former holder are refused.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, unique
from typing import Final, assert_never

from executive.commands import OWN_LINKS, RELAY_LINK, ROS_LINK, Command
from executive.commands.intake import is_valid_source
from executive.record import Ledger
from executive.settings import AuthoritySettings
from executive.values.clock import Clock
from executive.values.reasons import Figure, Reason, Refusal

ACQUIRE_HINT: Final = "request it from its holder by requestAuthority (`rover authority request`)"
REQUEST_HINT: Final = "request it first (`rover authority request`)"
HOLD_LEASE_S: Final = 5.0
"""Lease of a source that holds the authority by its commands: an operator gets it soon after."""


@dataclass(frozen=True, slots=True)
class AuthorityState:
    """The state of the authority.

    Attributes:
        holder: name of the holder; None without one.
        epoch: the number of the last grant, 0 before the first.
        lease_left_s: seconds until the lease expires without a contact of the holder.
        lease_s: lease duration in seconds.
        requested_by: the last source that requested it since the grant.
        needed: whether commands need it.
    """

    holder: str | None
    epoch: int
    lease_left_s: float
    lease_s: float
    requested_by: str | None
    needed: bool


@unique
class AuthorityAction(Enum):
    """Requests concerning the authority."""

    REQUEST = "request"
    TAKE = "take"
    HAND_OVER = "hand_over"
    RELEASE = "release"


@dataclass(frozen=True, slots=True)
class AuthorityRequest:
    """A request concerning the authority: a method of `Authority`, and its arguments.

    Attributes:
        epoch: epoch of the grant that is handed over or released.
        to, lease_s: arguments of `HAND_OVER`.
    """

    act: AuthorityAction
    source: str
    epoch: int = 0
    to: str = ""
    lease_s: float | None = None


GRANT_UNWRITTEN: Final = Refusal(
    Reason.LEDGER_FAILED, "the authority is not granted: the ledger cannot be written"
)


_SCHEMA: Final = """
CREATE TABLE IF NOT EXISTS authority (
    only_row INTEGER PRIMARY KEY, holder TEXT, epoch INTEGER NOT NULL, lease_s REAL NOT NULL,
    given_by TEXT
);
"""


@dataclass(frozen=True, slots=True)
class Grant:
    """The last grant.

    Attributes:
        holder: name of the holder; None if it was released since, or never granted.
        epoch: the number of the grant, one more than that of the grant before; 0 before the first.
        lease_s: lease in seconds after each contact of the holder.
        granted_by: source that handed it over; None if it was requested or taken.
    """

    holder: str | None = None
    epoch: int = 0
    lease_s: float = 0.0
    granted_by: str | None = None


class AuthorityRecord:
    """The last grant; every method raises LedgerError if the file cannot be used."""

    def __init__(self, ledger: Ledger) -> None:
        self._ledger = ledger
        ledger.add_tables(_SCHEMA)

    def read(self) -> Grant:
        """Return the last committed grant."""
        rows = self._ledger.rows("SELECT holder, epoch, lease_s, given_by FROM authority")
        return Grant(*rows[0]) if rows else Grant()

    @property
    def failing(self) -> bool:
        """Whether grants cannot be stored at present."""
        return self._ledger.failing

    def save(self, grant: Grant) -> None:
        """Write a grant with the next commit.

        Its requester gets it after that, so that its number is not granted again after a crash.
        """
        values = (grant.holder, grant.epoch, grant.lease_s, grant.granted_by)
        self._ledger.write("INSERT OR REPLACE INTO authority VALUES (0, ?, ?, ?, ?)", values)


class Authority:
    """Grants the authority, and checks commands against it.

    After a restart the holder is unchanged, with its full lease.

    Args:
        clock: monotonic clock for the lease, unaffected by steps of the wall clock.
        record: stores grants.
        notify: called with one line on each change of holder and each request.
    """

    def __init__(
        self,
        clock: Clock,
        settings: AuthoritySettings,
        record: AuthorityRecord,
        notify: Callable[[str], None],
    ) -> None:
        self._clock = clock
        self._settings = settings
        self._record = record
        self._notify = notify
        self._grant = self._stored = record.read()
        self._last_epoch = self._grant.epoch
        self._end_s = clock.now_s() + self._grant.lease_s
        self._requested_by: str | None = None
        self._requested_s = 0.0

    @property
    def state(self) -> AuthorityState:
        """The present state."""
        left_s = 0.0 if self._holder is None else self._end_s - self._clock.now_s()
        return AuthorityState(
            self._holder,
            self._grant.epoch,
            left_s,
            self._grant.lease_s or self._settings.lease_s,
            self._requested_by,
            bool(self._settings.needed),
        )

    @property
    def _holder(self) -> str | None:
        return self._grant.holder if self._clock.now_s() < self._end_s else None

    @property
    def grant(self) -> Grant:
        """The present grant."""
        return self._grant

    def on_written(self, grant: Grant, written: bool) -> Refusal | None:
        """Note that a grant was stored; if it could not be, the last stored one applies again.

        Returns:
            The refusal if it could not be stored.
        """
        if written:
            self._stored = grant
            return None
        if self._grant != self._stored:
            self._grant = self._stored
            self._record.save(self._grant)
        return GRANT_UNWRITTEN

    def perform(self, request: AuthorityRequest) -> AuthorityState | Refusal:
        """Execute a request."""
        match request.act:
            case AuthorityAction.REQUEST:
                return self.request(request.source)
            case AuthorityAction.TAKE:
                return self.take(request.source)
            case AuthorityAction.HAND_OVER:
                return self.hand_over(request.source, request.epoch, request.to, request.lease_s)
            case AuthorityAction.RELEASE:
                return self.release(request.source, request.epoch)
            case _:
                assert_never(request.act)

    def request(self, source: str) -> AuthorityState | Refusal:
        """Grant it if it is free, renew the holder's lease, or notify the holder of the request."""
        if self._holder is None:
            return self._transfer(source, f"{source} holds the authority")
        if self._holder == source:
            self._renew()
            return self.state
        if not is_valid_source(source):
            return _invalid_source(source)
        now_s = self._clock.now_s()
        if self._requested_by is None or now_s - self._requested_s >= self._settings.lease_s:
            self._notify(f"{source} requests the authority that {self._holder} holds")
            self._requested_by, self._requested_s = source, now_s
        return self._refusal("the authority is not free", ACQUIRE_HINT)

    def take(self, source: str) -> AuthorityState | Refusal:
        """Take it from any holder, if the source is permitted to; otherwise as `request`."""
        holder = self._holder
        if holder is None or holder == source or source not in self._settings.takeover_sources:
            return self.request(source)
        return self._transfer(source, f"{source} took the authority from {holder}")

    def hand_over(
        self, source: str, epoch: int, to: str, lease_s: float | None = None
    ) -> AuthorityState | Refusal:
        """Hand the authority over from its holder to another source.

        Args:
            source: the holder.
            epoch: epoch of the holder's grant.
            to: the new holder, such as the orbiter.
            lease_s: the new holder's lease in seconds; None for the asset's own.
        """
        if (self._holder, self._grant.epoch) != (source, epoch):
            return self._refusal(f"{source} does not hold authority {epoch}", ACQUIRE_HINT)
        max_s = self._settings.max_lease_s
        if lease_s is not None and not 0.0 < lease_s <= max_s:
            figures = (Figure("lease", lease_s, "s"), Figure("bound", max_s, "s"))
            text = f"a lease of {lease_s:g} s is not above 0 and at most {max_s:g} s"
            return Refusal(Reason.OUT_OF_RANGE, text, figures, argument=3)
        if not is_valid_source(to):
            return _invalid_source(to, 2)
        text = f"{source} handed the authority over to {to}"
        return self._transfer(to, text, lease_s, given_by=source)

    def release(self, source: str, epoch: int) -> AuthorityState | Refusal:
        """Release the authority of its holder."""
        if (self._holder, self._grant.epoch) != (source, epoch):
            return self._refusal(f"{source} does not hold authority {epoch}", ACQUIRE_HINT)
        return self._store_grant(Grant(None, epoch), f"{source} released the authority")

    def hold(self, source: str) -> bool:
        """Grant it to a source if it is free, or renew its lease; return whether it may command."""
        if not self._settings.needed:
            return True
        if self._holder == source:
            self._renew()
        elif self._holder is None:
            text = f"{source} holds the authority by its commands"
            self._transfer(source, text, min(HOLD_LEASE_S, self._settings.lease_s))
        return self._holder == source

    def settle(self, grant: Grant, written: bool) -> None:
        """Note whether a grant was stored, as `on_written`."""
        self.on_written(grant, written)

    def check_command(self, command: Command) -> Refusal | None:
        """Return a refusal if the sender may not give the command, or None; renew the lease.

        A command of a ROS client claims none: `hold` requests it once the command is accepted.
        The sender of a relayed command is the orbiter, on behalf only of the source that handed the
        authority over to it. Commands of a plan have the authority of the source that activated it;
        the executive needs none.
        """
        claimed = command.authority
        if command.link in OWN_LINKS or (claimed is None and not self._settings.needed):
            return None
        if command.link == ROS_LINK:
            return self._check_unrequested(command.identity.source)
        if claimed is None:
            if self._holder is None:
                return self._refusal("a command needs the authority", REQUEST_HINT)
            return self._refusal("a command needs the authority", ACQUIRE_HINT)
        source = sender = command.identity.source
        given_by = self._grant.granted_by
        if command.link == RELAY_LINK:
            sender = self._settings.relay
            if self._holder == sender and given_by not in {None, source}:
                return self._refusal(f"{source} is not {given_by}, the grantor", ACQUIRE_HINT)
        if (self._holder, self._grant.epoch) == (sender, claimed):
            self._renew()
            return None
        wrong = f"{sender} does not hold authority {claimed}"
        return self._refusal(wrong, REQUEST_HINT if self._holder is None else ACQUIRE_HINT)

    def _check_unrequested(self, source: str) -> Refusal | None:
        """Return a refusal if a source can neither get the authority nor use it, or None."""
        if self._holder not in {None, source}:
            return self._refusal("a command needs the authority", ACQUIRE_HINT)
        if self._holder == source and self._requested_by not in {None, source}:
            wrong = f"{self._requested_by} requested the authority"
            return self._refusal(wrong, "it is released after the present goals")
        return None

    def renew_lease(self, epoch: int) -> None:
        """Renew the lease after another process accepted a command under this authority."""
        if self._holder is not None and self._grant.epoch == epoch:
            self._renew()

    def tick(self) -> None:
        """Report the expiry of the lease."""
        former = self._grant.holder
        if former is None or self._holder is not None:
            return
        self._store_grant(Grant(None, self._grant.epoch), f"the authority of {former} has expired")
        self._stored = self._grant

    def _renew(self) -> None:
        self._end_s = max(self._end_s, self._clock.now_s() + self._grant.lease_s)

    def _transfer(
        self,
        source: str,
        text: str,
        lease_s: float | None = None,
        given_by: str | None = None,
    ) -> AuthorityState | Refusal:
        if not is_valid_source(source):
            return _invalid_source(source)
        self._last_epoch += 1  # not granted again, even if the commit fails
        lease_s = self._settings.lease_s if lease_s is None else lease_s
        grant = Grant(source, self._last_epoch, lease_s, given_by)
        return self._store_grant(grant, f"{text} (epoch {grant.epoch})")

    def _store_grant(self, grant: Grant, text: str) -> AuthorityState | Refusal:
        if self._record.failing:
            return GRANT_UNWRITTEN
        self._record.save(grant)
        self._grant = grant
        self._end_s = self._clock.now_s() + grant.lease_s
        self._requested_by = None
        self._notify(text)
        return self.state

    def _refusal(self, wrong: str, recovery: str) -> Refusal:
        state = self.state
        if state.holder is None:
            return Refusal(
                Reason.NO_AUTHORITY,
                f"{wrong}: it is free; {recovery}",
                (Figure("epoch", state.epoch),),
            )
        return Refusal(
            Reason.NO_AUTHORITY,
            f"{wrong}: {state.holder} holds it for another {state.lease_left_s:.0f} s; {recovery}",
            (Figure("epoch", state.epoch), Figure("lease left", state.lease_left_s, "s")),
        )


def _invalid_source(source: str, argument: int = 0) -> Refusal:
    text = f"{source[:40]!r} is not a valid source name"
    return Refusal(Reason.BAD_IDENTIFIER, text, argument=argument)
