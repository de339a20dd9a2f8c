"""What must hold of the authority, at each kill and in the end: that no two hold it."""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from executive.commands import Stop
from executive.values.reports import Identity, Stage
from tests.simulated.authority_requests import ORBITER
from tests.simulated.disk import rows
from tests.simulated.ground import Journal
from tests.simulated.judge import Finding
from tests.simulated.world import World

_GRANT: Final = re.compile(r"(\S+) .* (\S+) \(epoch (\d+)\)$")


class AuthorityJudge:
    """Checks that at no time two hold the authority.

    Args:
        world: with the process executive.
        needed: whether commands need it.
        journals: of all ground clients, by their processes.
        sources: under which names they command.
    """

    def __init__(
        self,
        world: World,
        needed: bool,
        journals: Mapping[str, Journal],
        sources: Mapping[str, str],
    ) -> None:
        self._world, self._needed = world, needed
        self._journals, self._sources = journals, sources
        self._last_epoch = 0

    def check(self) -> Iterator[Finding]:
        """Check at any moment: what was told is on the disk, and nothing of it is taken back."""
        now_s = self._world.now_s
        found = self._rows("SELECT holder, epoch FROM authority", "authority")
        holder, epoch = found[0] if found else (None, 0)
        if epoch < self._last_epoch:
            what = "an epoch of the authority was taken back"
            yield Finding(now_s, what, f"{self._last_epoch}, then {epoch}")
        self._last_epoch = epoch
        holders: dict[int, set[str]] = {} if holder is None else {epoch: {holder}}
        for reported, source in self._granted():
            holders.setdefault(reported, set()).add(source)
        for each, names in holders.items():
            if len(names) > 1:
                what = "two operators hold one epoch of the authority"
                yield Finding(now_s, what, f"{each}: {sorted(names)}")
            if each > epoch:
                what = "an operator was told of a grant that is not on the disk"
                yield Finding(now_s, what, f"{each} of {sorted(names)}, and the last is {epoch}")

    def check_end(self) -> Iterator[Finding]:
        """Check in the end: what began did so under the authority of who sent it."""
        yield from self.check()
        holders = dict(self._granted())
        claims: dict[Identity, list[int | None]] = {}
        free: set[Identity] = set()
        for journal in self._journals.values():
            for identity, claimed in journal.claims.items():
                claims.setdefault(identity, []).extend(claimed)
                if isinstance(journal.requests[identity], Stop):
                    free.add(identity)
        query = "SELECT sequence, text, source, command_id, stage FROM reports ORDER BY sequence"
        present = 0
        for _, text, source, number, stage in self._rows(query, "reports"):
            if number is None:
                if (granted := _GRANT.search(text)) is not None:
                    present = int(granted[3])
                    if granted[2] == ORBITER:
                        holders[present] = granted[1]  # which commands by it
                continue
            identity = Identity(source, number)
            if stage != Stage.ACCEPTED.value or identity in free:
                continue
            claimed = claims[identity]
            if not self._may(claimed, present, holders, source):
                what = "a command was accepted without the authority"
                detail = f"{identity} claims {claimed} under {present} of {holders.get(present)}"
                yield Finding(self._world.now_s, what, detail)
        for name, journal in self._journals.items():
            for identity, refusal in journal.refused.items():
                if not refusal:
                    what = "a command was refused without a reason"
                    yield Finding(self._world.now_s, what, f"{identity} by {name}")

    def _may(
        self, claims: list[int | None], present: int, holders: Mapping[int, str], source: str
    ) -> bool:
        if None in claims and not self._needed:
            return True
        claimed = [each for each in claims if each is not None and each >= present]
        return any(holders.get(each) == source for each in claimed)

    def _granted(self) -> Iterator[tuple[int, str]]:
        """Yield the epochs that operators hold by what they were told, each with whose it is."""
        for name, journal in self._journals.items():
            for epoch in journal.epochs:
                yield epoch, self._sources[name]

    def _rows(self, query: str, table: str) -> list[tuple[Any, ...]]:
        path = self._world.processes["executive"].stored / "ledger.sqlite"
        if not _has(path, table):
            return []
        return rows(path, query)


def _has(path: Path, table: str) -> bool:
    query = "SELECT 1 FROM sqlite_schema WHERE name = ?"
    return path.exists() and bool(rows(path, query, (table,)))
