"""Faults of MOCUP's processes that storms, or a situation, must find; see `planted.py`."""

from contextlib import AbstractContextManager
from typing import Any
from unittest.mock import patch

from adapters.mocup import ClaimAnnouncer
from adapters.mocup.brick.record import BrickCommand, BrickLink, BrickRecord, ExecutiveClaim
from adapters.mocup.brick.replies import BrickReplies
from adapters.mocup.brick.router import Router
from adapters.mocup.brick.service import BrickService
from adapters.mops import Message
from executive.values.reasons import Reason


def refusal_not_recorded() -> AbstractContextManager[object]:
    def reject(
        self: Router, link: BrickLink, command: Message, text: str, reason: Reason | None = None
    ) -> None:
        self._out.reject((link,), command, text, reason)

    return patch.object(Router, "_reject", reject)


def repeat_passed_on() -> AbstractContextManager[object]:
    return patch.object(Router, "_answer_repeat", lambda *_: False)


def reply_sent_once() -> AbstractContextManager[object]:
    init = BrickService.__init__

    def unconfirmed(self: BrickService, router: Router, confirm: Any, **_: bool) -> None:
        init(self, router, confirm, confirmed=False)

    return patch.object(BrickService, "__init__", unconfirmed)


def end_not_recorded() -> AbstractContextManager[object]:
    answer = BrickReplies.answer

    def always(self: BrickReplies, requested: BrickCommand, reply: Message) -> None:
        answer(self, requested, reply)
        if self._unrecorded.pop(requested.command, None) is not None:
            for link in requested.links:
                self._out.notify(link, reply)

    return patch.object(BrickReplies, "answer", always)


def claimed_in_two_commits() -> AbstractContextManager[object]:
    save = BrickRecord.save_claim

    def save_first(
        self: BrickRecord, claim: ExecutiveClaim, instead: BrickCommand | None = None
    ) -> None:
        save(self, claim)
        if instead is not None:
            self.forget(instead)

    return patch.object(BrickRecord, "save_claim", save_first)


def commits_not_synced() -> AbstractContextManager[object]:
    def sync(self: BrickRecord) -> None:
        self.durable = self.sealed

    return patch.object(BrickRecord, "sync", sync)


def announced_once() -> AbstractContextManager[object]:
    return patch.object(ClaimAnnouncer, "poll", lambda _: None)
