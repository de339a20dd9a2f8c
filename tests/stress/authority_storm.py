"""Operators and an orbiter after one authority, in random interleavings, over restarts.

An oracle of its own says who may command: nobody else ever does, and a stop always acts.
"""

import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import Enum, unique
from pathlib import Path
from random import Random
from typing import Final

from adapters.mocup import ClaimAnnouncer, relay_authority
from adapters.mocup.brick.record import BrickLink
from adapters.mops import CommandConditions, authority_of, decode, messages_in
from executive.commands import RELAY_LINK, Command, Mode, Resume, SetTravelSpeed, Stop
from executive.commands.lifecycle import Accepted
from executive.core.authority import AuthorityRecord, AuthorityState
from executive.settings import MIN_REPORTS, AuthoritySettings, Settings
from executive.values.facts import ExternalAuthorityUse
from executive.values.ports import Downlink
from executive.values.reasons import Refusal
from executive.values.reports import Identity
from tests.mocup.brick.routing import DICTIONARY, executed
from tests.mocup.brick.routing import Bench as RouterBench
from tests.stress.findings import Findings, Log
from tests.support.figures import Figure
from tests.support.kinematic import Bench

ORBITER: Final = "MOPS"
TAKER: Final = "MOE-2"
OPERATORS: Final = ("MOE-1", TAKER, ORBITER)
RULES: Final = AuthoritySettings(needed=True, lease_s=5.0, takeover_sources=(TAKER,), relay=ORBITER)
STEPS: Final = 6
"""Of one interleaving."""
LONG_LEASE_S: Final = 20.0


@unique
class AuthorityFault(Enum):
    """What must not be."""

    TWO_HOLDERS = "holders beside the one there is"
    UNAUTHORIZED = "commands executed without authority"
    REFUSED = "commands of the holder refused"
    EPOCH = "changes of holder without an epoch above all before"
    STOP = "stops that did not act"


@dataclass(slots=True)
class Oracle:
    """Who holds the authority by the rules, kept apart from what is tried."""

    holder: str | None = None
    epoch: int = 0
    lease_s: float = 0.0
    given_by: str | None = None
    end_s: float = 0.0

    def holder_at(self, now_s: float) -> str | None:
        return self.holder if now_s < self.end_s else None

    def pass_to(
        self, holder: str, epoch: int, now_s: float, lease_s: float, given_by: str | None
    ) -> None:
        self.holder, self.epoch, self.lease_s = holder, epoch, lease_s
        self.given_by = given_by
        self.end_s = now_s + lease_s

    def renew(self, now_s: float) -> None:
        self.end_s = max(self.end_s, now_s + self.lease_s)


@dataclass
class Storm:
    """Operators that act as they like on one executive.

    Attributes:
        claims: the epoch that each operator was last told.
        stops, crashes, executed: how many there were.
    """

    bench: Bench
    random: Random
    findings: Findings
    oracle: Oracle = field(default_factory=Oracle)
    claims: dict[str, int] = field(default_factory=lambda: dict.fromkeys(OPERATORS, 1))
    number: int = 0
    stops: int = 0
    crashes: int = 0
    executed: int = 0

    def interleave(self) -> None:
        """Let one interleaving of acts happen, and look at its end."""
        acts = (self._request, self._take, self._hand_over, self._release, self._wait, self._stop)
        weights = (3, 1, 2, 1, 3, 1)
        for act in self.random.choices((*acts, self._command), (*weights, 10), k=STEPS):
            act(self.random.choice(OPERATORS))
            state = self.bench.executive.authority.state
            if (state.holder, state.epoch) != (self._holder, self.oracle.epoch):
                self.findings.add(AuthorityFault.TWO_HOLDERS, f"{state}, not {self.oracle}")
        if self.random.random() < 0.01:
            self._crash()

    @property
    def _now_s(self) -> float:
        return self.bench.clock.now_s()

    @property
    def _holder(self) -> str | None:
        return self.oracle.holder_at(self._now_s)

    def _request(self, name: str) -> None:
        granted = self.bench.executive.authority.request(name)
        if self._holder == name:
            self.oracle.renew(self._now_s)
        elif self._holder is None:
            self._pass_to(name, RULES.lease_s, granted)
        self._note(name, granted)

    def _take(self, name: str) -> None:
        granted = self.bench.executive.authority.take(name)
        if self._holder == name:
            self.oracle.renew(self._now_s)
        elif self._holder is None or name == TAKER:
            self._pass_to(name, RULES.lease_s, granted)
        self._note(name, granted)

    def _hand_over(self, name: str) -> None:
        to, lease_s = self.random.choice(OPERATORS), self.random.choice((None, LONG_LEASE_S))
        claim = self._claim(name)
        granted = self.bench.executive.authority.hand_over(name, claim, to, lease_s)
        if (self._holder, self.oracle.epoch) == (name, claim):
            self._pass_to(to, lease_s or RULES.lease_s, granted, given_by=name)
            self._note(to, granted)

    def _release(self, name: str) -> None:
        claim = self._claim(name)
        self.bench.executive.authority.release(name, claim)
        if (self._holder, self.oracle.epoch) == (name, claim):
            self.oracle.holder = None

    def _wait(self, _: str) -> None:
        self.bench.clock.advance(self.random.choice((0.1, 1.0, 4.0, 5.0, 12.0)))
        self.bench.executive.tick()

    def _stop(self, name: str) -> None:
        self.stops += 1
        claim = self.random.choice((None, 0, self.claims[name]))
        stopped = self._send(name, name, Stop(), claim)
        if not stopped or self.bench.executive.mode is not Mode.STOPPED:
            self.findings.add(AuthorityFault.STOP, f"of {name}")

    def _command(self, name: str) -> None:
        claim = self._claim(name) if self.random.random() < 0.9 else None
        kind: Callable[[], Resume | SetTravelSpeed] = lambda: SetTravelSpeed(0.5)  # noqa: E731
        if self.bench.executive.mode is Mode.STOPPED:
            kind = Resume
        may = claim is not None and (self._holder, self.oracle.epoch) == (name, claim)
        source = self.random.choice(OPERATORS[:2]) if name == ORBITER else name
        if name == ORBITER and self.oracle.given_by not in {None, source}:
            may = False
        if may:
            self.oracle.renew(self._now_s)
        executed = self._send(name, source, kind(), claim)
        self.executed += executed
        if executed and not may:
            self.findings.add(AuthorityFault.UNAUTHORIZED, f"{name} claims {claim}: {self.oracle}")
        if may and not executed:
            self.findings.add(AuthorityFault.REFUSED, f"{name} claims {claim}: {self.oracle}")

    def _claim(self, name: str) -> int:
        """Return the epoch that an operator knows, sometimes one that it cannot."""
        if self.random.random() < 0.8:
            return self.claims[name]
        return self.random.choice((*self.claims.values(), self.oracle.epoch, 0, -1))

    def _send(
        self, name: str, source: str, request: Resume | SetTravelSpeed | Stop, claim: int | None
    ) -> bool:
        self.number += 1
        link = RELAY_LINK if name == ORBITER else "direct"
        command = Command(Identity(source, self.number), request, link, authority=claim)
        return isinstance(self.bench.send(command), Accepted)

    def _pass_to(
        self,
        name: str,
        lease_s: float,
        granted: AuthorityState | Refusal,
        given_by: str | None = None,
    ) -> None:
        if isinstance(granted, Refusal) or granted.epoch <= self.oracle.epoch:
            self.findings.add(AuthorityFault.EPOCH, f"{name}: {granted}, after {self.oracle}")
            return
        self.oracle.pass_to(name, granted.epoch, self._now_s, lease_s, given_by)

    def _note(self, name: str, granted: AuthorityState | Refusal) -> None:
        if isinstance(granted, Refusal):
            return
        self.claims[name] = granted.epoch
        if granted.holder != name:
            self.findings.add(AuthorityFault.TWO_HOLDERS, f"{granted} for {name}")

    def _crash(self) -> None:
        """Lose the executive: the holder stays, with the whole lease before it."""
        self.bench.executive.tick()  # so that a lease that has run out is written down
        self.crashes += 1
        if self._holder is None:
            self.oracle.holder = None
        self.bench.crash()
        self.oracle.end_s = self._now_s + self.oracle.lease_s


class BrickBench(Bench):
    """An executive, and the router of `rover-nxt` beside it, which has the relay's commands."""

    nxt: RouterBench

    def downlinks(self) -> list[Downlink]:
        if not hasattr(self, "nxt"):
            self.nxt = RouterBench()
        grants = AuthorityRecord(self.ledger)
        self.claims = ClaimAnnouncer(
            DICTIONARY,
            self.ledger.request,
            lambda: relay_authority(self.settings.authority, grants.read()),
            self._notify,
            "EXEC",
            "MOCUP",
        )
        self.claims.resend(())
        return [*super().downlinks(), self.claims]

    def _notify(self, text: str) -> None:
        self.nxt.command(BrickLink.DIRECT, *messages_in(text, list[str]().append))

    def relayed(self, command: Command) -> bool:
        """Have a command come by the relay; return whether the brick was asked for it."""
        self.executive.serve_inbox()
        conditions = CommandConditions(command.authority)
        message = DICTIONARY.command(command.request, command.identity, "MOCUP", conditions)
        self.nxt.command(BrickLink.RELAY, message)
        requested, reported = (
            [decode(octets) for octets in self.nxt.ports.brick],
            self.nxt.ports.notified,
        )
        self.nxt.sends(*map(executed, requested))
        for link, reply in reported:
            if link is BrickLink.DIRECT and reply.code == DICTIONARY.spelling.authority.code:
                self.executive.observe(ExternalAuthorityUse(authority_of(reply).epoch or 0))
        self.nxt.ports.brick.clear()
        reported.clear()
        return requested == [replace(message, outputs=())]


class BrickStorm(Storm):
    """The same where the commands of the relay do not go by the executive; `rover-nxt` is killed.

    It hears of the authority what the executive told before it was killed itself, and no more.
    """

    bench: BrickBench

    def _stop(self, name: str) -> None:
        if name != ORBITER:
            super()._stop(name)
            return
        self.stops += 1
        if not self._relayed(name, Stop(), self.random.choice((None, 0, self.claims[name]))):
            self.findings.add(AuthorityFault.STOP, "by the relay")

    def _send(
        self, name: str, source: str, request: Resume | SetTravelSpeed | Stop, claim: int | None
    ) -> bool:
        if name != ORBITER:
            return super()._send(name, source, request, claim)
        if claim is not None and claim < 0:
            claim = 0
        return self._relayed(source, request, claim)

    def _relayed(
        self, source: str, request: Resume | SetTravelSpeed | Stop, claim: int | None
    ) -> bool:
        self.number += 1
        if self.random.random() < 0.2:
            self.bench.nxt.start(self.bench.nxt.router.record)
            for _ in range(3):
                self.bench.nxt.router.poll()
        identity = Identity(source, self.number)
        return self.bench.relayed(Command(identity, request, RELAY_LINK, authority=claim))


def measure(
    settings: Settings, count: int, seed: int, log: Log, *, brick: bool = False
) -> list[Figure]:
    """Return how often the authority failed in this many interleavings.

    Args:
        settings: of the asset.
        count: of the interleavings.
        seed: which they are.
        log: called with a line on each failure.
        brick: whether the relay's commands go to a brick, by `rover-nxt`.
    """
    settings = replace(settings, authority=RULES, retained_reports=MIN_REPORTS)
    findings = Findings(log)
    with tempfile.TemporaryDirectory() as name:
        folder, random = Path(name), Random(seed)
        with BrickBench(folder, settings) if brick else Bench(folder, settings) as bench:
            kind = BrickStorm if brick else Storm
            storm = kind(bench, random, findings)
            for _ in range(count):
                storm.interleave()
    beside = (
        f"{count} interleavings of {STEPS} acts, {storm.executed} commands executed,"
        f" {storm.stops} stops, {storm.crashes} crashes"
    )
    return findings.figures("authority", AuthorityFault, beside)
