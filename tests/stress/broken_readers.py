"""Ways to break those who read MOPS strings, each undone by `monkeypatch` when its test ends."""

import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import count
from typing import Any

import pytest

from adapters.mocup.brick.record import BrickLink
from adapters.mocup.brick.router import Router
from adapters.mops import Dictionary, Message, MopsStream, encode
from adapters.mops import codec as mops
from adapters.mops.dictionary import Entry
from adapters.relay.orbiter.rover import RelayedRover
from adapters.relay.rover.executive_link import ExecutiveRelayLink
from executive.commands.catalogue import SetTravelSpeed
from executive.core.runner import Executive
from executive.values.geometry import Velocity
from executive.values.reports import Identity, Report

RETAINED: list[Any] = []


def _around(patch: pytest.MonkeyPatch, kind: type, name: str, act: Callable[..., Any]) -> None:
    """Have a method called by `act(method, self, ...)`."""
    method = getattr(kind, name)

    def called(self: Any, *arguments: Any, **named: Any) -> Any:
        return act(partial(method, self), self, *arguments, **named)

    patch.setattr(kind, name, called)


def is_lenient(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(mops, "_NAME", re.compile("[ -~]*"))
    patch.setattr(mops, "_VALUE", re.compile(".*", re.DOTALL))


def raises(patch: pytest.MonkeyPatch) -> None:
    def entry_of(self: Dictionary, code: int) -> Entry:
        return self._by_code[code][0]

    patch.setattr(Dictionary, "entry_of", entry_of)


def does_not_find_back(patch: pytest.MonkeyPatch) -> None:
    lost: list[bytes] = []

    def whole(method: Any, self: MopsStream, piece: bytes) -> Message | None:
        message: Message | None = method(piece)
        if message is None:
            lost.append(piece)
        elif lost:
            lost.clear()
            self._drop(piece, len(piece), "still lost")
            return None
        return message

    _around(patch, MopsStream, "_complete_message", whole)


def is_silent(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(MopsStream, "_drop", lambda *_: None)


def reports_twice(patch: pytest.MonkeyPatch) -> None:
    def drop(method: Any, _: MopsStream, *piece: Any) -> None:
        method(*piece)
        method(*piece)

    _around(patch, MopsStream, "_drop", drop)


def reports_in_many_lines(patch: pytest.MonkeyPatch) -> None:
    def drop(method: Any, _: MopsStream, shown: bytes, octets: int, why: str) -> None:
        method(shown, octets, f"{why}\nin {octets} octets")

    _around(patch, MopsStream, "_drop", drop)


def writes_otherwise(patch: pytest.MonkeyPatch) -> None:
    def command(method: Any, _: Dictionary, *arguments: Any) -> Message:
        message: Message = method(*arguments)
        return replace(message, inputs=message.inputs[::-1])

    _around(patch, Dictionary, "command", command)


def has_the_brick_execute_foreign_commands(patch: pytest.MonkeyPatch) -> None:
    def take(method: Any, self: Router, link: BrickLink, message: Message) -> None:
        if message.dest == self.name:
            method(link, message)
        else:
            self.ports.to_brick(encode(message), 1)

    _around(patch, Router, "_handle_message", take)


def accepts_commands_without_source(patch: pytest.MonkeyPatch) -> None:
    numbers = count(1)

    def take(method: Any, self: ExecutiveRelayLink, message: Message, *reported: Any) -> None:
        method(message, *reported)
        absent = Identity("NOBODY", next(numbers))
        forged = self._dictionary.command(SetTravelSpeed(0.25), absent, self._asset)
        method(forged, *reported)

    _around(patch, ExecutiveRelayLink, "_handle_message", take)


def moves(patch: pytest.MonkeyPatch) -> None:
    def tick(method: Any, self: Executive) -> None:
        method()
        self._arbiter._rover.drive(Velocity(0.1, 0.0))  # type: ignore[attr-defined]

    _around(patch, Executive, "tick", tick)


def reports_unsent_messages(patch: pytest.MonkeyPatch) -> None:
    def report(method: Any, _: RelayedRover, *reported: Report | int) -> None:
        for again in [reported] * 9:
            method(*again)

    _around(patch, RelayedRover, "_report", report)


def grows(patch: pytest.MonkeyPatch) -> None:
    def whole(method: Any, _: MopsStream, piece: bytes) -> Message | None:
        RETAINED.append(bytearray(10_000))
        found: Message | None = method(piece)
        return found

    _around(patch, MopsStream, "_complete_message", whole)
