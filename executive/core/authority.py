"""Command authority: one operator at a time holds it over the asset (thesis 3.1).

The holder requests it and keeps a lease, renewed by each contact of the holder. It passes on by
hand-over, release, expiry of the lease, or takeover by a source that the settings permit. Each
grant has an epoch: a strictly increasing number that is committed to the ledger before any reply.
Commands carry it as a fencing token, so that commands of a former holder are refused.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, unique
from typing import Final, assert_never

from executive.commands import OWN_LINKS, RELAY_LINK, Command
from executive.commands.intake import is_source
from executive.record import AuthorityRecord, Grant, LedgerError
from executive.settings import AuthoritySettings
from executive.values.clock import Clock
from executive.values.reasons import Figure, Reason, Refusal

HOW_TO_GET: Final = "request it from its holder by requestAuthority (`rover authority request`)"
HOW_TO_REQUEST: Final = "request it first (`rover authority request`)"


@dataclass(frozen=True, slots=True)
class AuthorityState:
    """The state of the authority.

    Attributes:
        holder: name of the holder; None without one.
        epoch: the number of the last grant, 0 before the first.
        lease_left_s: seconds until the lease expires without a contact of the holder.
        lease_s: lease duration in seconds.
        asked_by: the last source that requested it since the grant.
        needed: whether commands need it.
    """

    holder: str | None
    epoch: int
    lease_left_s: float
    lease_s: float
    asked_by: str | None
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


class Authority:
    """Grants the authority, and checks commands against it.

    After a restart the holder is unchanged, with its full lease.

    Args:
        clock: monotonic clock for the lease, unaffected by steps of the wall clock.
        settings: authority settings of the asset.
        record: stores grants.
        tell: called with one line on each change of holder and each request.
    """

    def __init__(
        self,
        clock: Clock,
        settings: AuthoritySettings,
        record: AuthorityRecord,
        tell: Callable[[str], None],
    ) -> None:
        self._clock = clock
        self._settings = settings
        self._record = record
        self._tell = tell
        self._grant = record.read()
        self._last_epoch = self._grant.epoch
        self._end_s = clock.now_s() + self._grant.lease_s
        self._asked_by: str | None = None
        self._asked_s = 0.0

    @property
    def state(self) -> AuthorityState:
        """The present state."""
        left_s = 0.0 if self._holder is None else self._end_s - self._clock.now_s()
        return AuthorityState(
            self._holder,
            self._grant.epoch,
            left_s,
            self._grant.lease_s or self._settings.lease_s,
            self._asked_by,
            bool(self._settings.needed),
        )

    @property
    def _holder(self) -> str | None:
        return self._grant.holder if self._clock.now_s() < self._end_s else None

    def perform(self, asked: AuthorityRequest) -> AuthorityState | Refusal:
        """Execute a request."""
        match asked.act:
            case AuthorityAction.REQUEST:
                return self.request(asked.source)
            case AuthorityAction.TAKE:
                return self.take(asked.source)
            case AuthorityAction.HAND_OVER:
                return self.hand_over(asked.source, asked.epoch, asked.to, asked.lease_s)
            case AuthorityAction.RELEASE:
                return self.release(asked.source, asked.epoch)
            case _:
                assert_never(asked.act)

    def request(self, source: str) -> AuthorityState | Refusal:
        """Grant it if it is free, renew the holder's lease, or notify the holder of the request."""
        if self._holder is None:
            return self._pass_to(source, f"{source} holds the authority")
        if self._holder == source:
            self._renew()
            return self.state
        if not is_source(source):
            return _no_name(source)
        now_s = self._clock.now_s()
        if self._asked_by is None or now_s - self._asked_s >= self._settings.lease_s:
            self._tell(f"{source} requests the authority that {self._holder} holds")
            self._asked_by, self._asked_s = source, now_s
        return self._refusal("the authority is not free", HOW_TO_GET)

    def take(self, source: str) -> AuthorityState | Refusal:
        """Take it from any holder, if the source is permitted to; otherwise as `request`."""
        holder = self._holder
        if holder is None or holder == source or source not in self._settings.may_take:
            return self.request(source)
        return self._pass_to(source, f"{source} took the authority from {holder}")

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
            return self._refusal(f"{source} does not hold authority {epoch}", HOW_TO_GET)
        longest_s = self._settings.longest_lease_s
        if lease_s is not None and not 0.0 < lease_s <= longest_s:
            figures = (Figure("lease", lease_s, "s"), Figure("bound", longest_s, "s"))
            text = f"a lease of {lease_s:g} s is not above 0 and at most {longest_s:g} s"
            return Refusal(Reason.OUT_OF_RANGE, text, figures, argument=3)
        if not is_source(to):
            return _no_name(to, 2)
        text = f"{source} handed the authority over to {to}"
        return self._pass_to(to, text, lease_s, given_by=source)

    def release(self, source: str, epoch: int) -> AuthorityState | Refusal:
        """Release the authority of its holder."""
        if (self._holder, self._grant.epoch) != (source, epoch):
            return self._refusal(f"{source} does not hold authority {epoch}", HOW_TO_GET)
        return self._keep(Grant(None, epoch), f"{source} released the authority")

    def judge(self, command: Command) -> Refusal | None:
        """Return a refusal if the sender may not give the command, or None; renew the lease.

        The sender of a relayed command is the orbiter, on behalf only of the source that handed the
        authority over to it. Commands of a plan have the authority of the source that activated it;
        the executive needs none.
        """
        claimed = command.authority
        if command.link in OWN_LINKS or (claimed is None and not self._settings.needed):
            return None
        if claimed is None:
            if self._holder is None:
                return self._refusal("a command needs the authority", HOW_TO_REQUEST)
            return self._refusal("a command needs the authority", HOW_TO_GET)
        source = sender = command.identity.source
        given_by = self._grant.given_by
        if command.link == RELAY_LINK:
            sender = self._settings.relay
            if self._holder == sender and given_by not in {None, source}:
                return self._refusal(f"{source} is not {given_by}, the grantor", HOW_TO_GET)
        if (self._holder, self._grant.epoch) == (sender, claimed):
            self._renew()
            return None
        wrong = f"{sender} does not hold authority {claimed}"
        return self._refusal(wrong, HOW_TO_REQUEST if self._holder is None else HOW_TO_GET)

    def used(self, epoch: int) -> None:
        """Renew the lease after another process accepted a command under this authority."""
        if self._holder is not None and self._grant.epoch == epoch:
            self._renew()

    def tick(self) -> None:
        """Report the expiry of the lease."""
        former = self._grant.holder
        if former is None or self._holder is not None:
            return
        self._keep(Grant(None, self._grant.epoch), f"the authority of {former} has expired")

    def _renew(self) -> None:
        self._end_s = max(self._end_s, self._clock.now_s() + self._grant.lease_s)

    def _pass_to(
        self,
        source: str,
        text: str,
        lease_s: float | None = None,
        given_by: str | None = None,
    ) -> AuthorityState | Refusal:
        if not is_source(source):
            return _no_name(source)
        self._last_epoch += 1  # not granted again, even if the commit fails
        lease_s = self._settings.lease_s if lease_s is None else lease_s
        grant = Grant(source, self._last_epoch, lease_s, given_by)
        return self._keep(grant, f"{text} (epoch {grant.epoch})")

    def _keep(self, grant: Grant, text: str) -> AuthorityState | Refusal:
        try:
            self._record.keep(grant, self._grant)
        except LedgerError as error:
            return Refusal(Reason.LEDGER_FAILED, f"the authority is not granted: {error}")
        self._grant = grant
        self._end_s = self._clock.now_s() + grant.lease_s
        self._asked_by = None
        self._tell(text)
        return self.state

    def _refusal(self, wrong: str, way_out: str) -> Refusal:
        state = self.state
        if state.holder is None:
            return Refusal(
                Reason.NO_AUTHORITY,
                f"{wrong}: it is free; {way_out}",
                (Figure("epoch", state.epoch),),
            )
        return Refusal(
            Reason.NO_AUTHORITY,
            f"{wrong}: {state.holder} holds it for another {state.lease_left_s:.0f} s; {way_out}",
            (Figure("epoch", state.epoch), Figure("lease left", state.lease_left_s, "s")),
        )


def _no_name(source: str, argument: int = 0) -> Refusal:
    text = f"{source[:40]!r} is not a valid source name"
    return Refusal(Reason.BAD_IDENTITY, text, argument=argument)
