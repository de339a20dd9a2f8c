"""Power cuts break no promise, and the check finds each gate that is removed."""

from math import inf

import pytest

from executive.goals import GoalQueue
from executive.record import Ledger, Notifications
from executive.values.reports import Identity
from tests.stress import ledger_kills


def broken(kills: int) -> set[str]:
    """Return the promises that are broken, in any mix."""
    figures = ledger_kills.measure(kills, 1, lambda _: None)
    return {each.name.partition(": ")[2] for each in figures if not each.met}


def test_promises_hold_over_power_cuts() -> None:
    assert broken(15) == set()


def test_a_motion_before_the_commit_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    free = property(lambda _: inf, lambda *_: None)
    monkeypatch.setattr(GoalQueue, "durable", free, raising=False)
    assert ledger_kills.PowerCut.MOVED.value in broken(15)


def test_a_report_before_the_commit_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    def send_all(self: Notifications) -> None:
        while self._outbox:
            self._send(self._outbox.popleft()[2])

    monkeypatch.setattr(Notifications, "send_committed", send_all)
    assert {ledger_kills.PowerCut.SENT.value, ledger_kills.PowerCut.ANSWERED.value} <= broken(15)


def test_a_repeat_unknown_before_the_commit_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    digest_of = Ledger.digest_of

    def on_disk(self: Ledger, identity: Identity) -> bytes | None:
        unwritten, self._unwritten = self._unwritten, {}
        try:
            return digest_of(self, identity)
        finally:
            self._unwritten = unwritten

    monkeypatch.setattr(Ledger, "digest_of", on_disk)
    assert ledger_kills.PowerCut.FAILED.value in broken(15)
