"""What must hold of MOCUP: of all stores, of what the brick did, and of what the ground knows."""

from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

from adapters.mops import Message
from executive.commands import MoveForward, RotateBy, Stop
from executive.values.reports import Identity, Stage
from tests.simulated.brick import DICTIONARY, SimBrick
from tests.simulated.disk import rows
from tests.simulated.ground import SOURCE, Journal
from tests.simulated.judge import Finding, check_known, identities, ledger_content
from tests.simulated.world import World

_MOTIONS: Final = frozenset(
    DICTIONARY.spelling.commands[name] for name in ("moveForward", "rotateBy", "drive")
)


class MocupJudge:
    """Checks MOCUP at each kill and in the end.

    Args:
        world: with processes orbiter, relay, nxt.
        asset: the rover.
        brick: what did the commands.
        journals: of the ground's processes.
        needed: whether commands need the authority.
    """

    def __init__(
        self,
        world: World,
        asset: str,
        brick: SimBrick,
        journals: Mapping[str, Journal],
        needed: bool,
    ) -> None:
        self._world, self._asset, self._brick = world, asset, brick
        self._journals, self._needed = journals, needed

    def check(self) -> Iterator[Finding]:
        """Check at any moment that no acknowledged command is lost, and none is done twice."""
        now_s = self._world.now_s
        orbiter, relay, nxt = (
            self._world.processes[name].stored for name in ("orbiter", "relay", "nxt")
        )
        up = identities(orbiter / "bundles.sqlite", "outbox", "octets")
        above = ledger_content(orbiter / f"{self._asset}.sqlite")
        somewhere = (
            up | above.ended | _requested(nxt / "nxt.sqlite")
            | identities(relay / "relay.sqlite", "inbox", "payload")
            | identities(relay / "relay.sqlite", "outbox", "octets")
            | identities(orbiter / "bundles.sqlite", "inbox", "payload")
        )  # fmt: skip
        for identity in self._journals["moe"].acknowledged:
            if identity not in somewhere:
                what = "a command that the orbiter acknowledged is in no store"
                yield Finding(now_s, what, f"{identity}")
            if identity not in up and identity not in above.commands:
                what = "a command that the orbiter acknowledged is not in its record"
                yield Finding(now_s, what, f"{identity}")
        yield from self._check_once()
        if self._stops_are_ordered:
            yield from self._check_order()

    def check_end(self) -> Iterator[Finding]:
        """Check what the ground knows after all faults are over, and that the brick did it."""
        yield from self.check()
        for name, journal in self._journals.items():  # each link has ends of its own
            yield from check_known(self._world, {name: journal})
        executed = {_identity(each) for each in self._brick.executed}
        executed |= {_identity(each) for _, each in self._brick.stops}
        for identity, stages in self._journals["moe"].ends.items():
            if identity in self._journals["direct"].sent:
                continue  # the executive may execute it without the brick
            request = self._journals["moe"].requests[identity]
            moves = isinstance(request, MoveForward | RotateBy | Stop)
            if moves and Stage.EXECUTED.name in stages and identity not in executed:
                what = "a command ended as executed that the brick did not execute"
                yield Finding(self._world.now_s, what, f"{identity}")

    def _check_once(self) -> Iterator[Finding]:
        begun = [each for _, each in self._brick.begun]
        messages = Counter((_identity(each), each.moe_inputs_counter) for each in begun)
        motions = Counter(_identity(each) for each in begun if each.code in _MOTIONS)
        for known in (messages, motions):
            for what, count in known.items():
                if count > 1:
                    promise = "the brick was given a command twice"
                    yield Finding(self._world.now_s, promise, f"{what}: {count} times")
        for identity in motions if self._needed else ():
            claims = [
                epoch for each in self._journals.values() for epoch in each.claims.get(identity, ())
            ]
            if not any(claims):
                promise = "the brick was given a command without the authority"
                yield Finding(self._world.now_s, promise, f"{identity}")

    @property
    def _stops_are_ordered(self) -> bool:
        """Return whether the relay can tell what was made before a stop; see `judge`."""
        orbiter, relay = self._world.processes["orbiter"], self._world.processes["relay"]
        return not (orbiter.stepped or relay.stepped or relay.disk.unwritten)

    def _check_order(self) -> Iterator[Finding]:
        """Check that nothing moves the brick after a stop that was sent later, by the relay."""
        relay, direct = self._journals["moe"], self._journals["direct"]
        stopped_s: dict[Identity, float] = {}
        for at_s, message in self._brick.stops:
            stopped_s.setdefault(_identity(message), at_s)
        for begun_s, command in self._brick.begun:
            identity = _identity(command)
            if command.code not in _MOTIONS or identity in direct.sent:
                continue
            taken_s = relay.acknowledged.get(identity, self._world.now_s)
            for stop, at_s in stopped_s.items():
                sent_s = relay.sent.get(stop) if stop not in direct.sent else None
                if sent_s is not None and taken_s < sent_s and at_s < begun_s:
                    what = "a command began after a stop that was sent later"
                    yield Finding(self._world.now_s, what, f"{identity}, {stop}")


def _identity(message: Message) -> Identity:
    return Identity(message.source, message.moe_inputs_id or 0)


def _requested(path: Path) -> frozenset[Identity]:
    """Return the commands in the record of `rover-nxt`."""
    if not path.exists() or not rows(path, "SELECT 1 FROM sqlite_schema WHERE name = 'claims'"):
        return frozenset()
    query = (
        "SELECT source, moe_id FROM commands UNION"
        " SELECT source, moe_id FROM claims WHERE relay_copy IS NOT NULL"
    )
    return frozenset(Identity(*row) for row in rows(path, query) if row[0] == SOURCE)
