"""Two operators with the authority in the simulated world; each check is shown to fail."""

from dataclasses import replace

import pytest

from adapters.mops import RelayAuthority
from executive.commands import MoveForward, SetTravelSpeed, Stop
from executive.core.authority import Authority, AuthorityRecord
from tests.simulated.authority_requests import RIVAL, Act, RequestAuthority
from tests.simulated.deeds import Deed, Kill, Link, Order, Storm
from tests.simulated.situations import CALM, MOCUP
from tests.simulated.storm import Played, play, player


def played(*deeds: Deed) -> Played:
    return play(Storm("authority", replace(CALM, authority_needed=True), deeds))


PASSED_ON: tuple[Deed, ...] = (
    RequestAuthority(15.0, "direct", Act.REQUEST),
    Order(16.0, Link.DIRECT, 1, SetTravelSpeed(0.2)),
    Order(16.0, Link.RIVAL, 1, SetTravelSpeed(0.3)),
    Order(16.0, Link.RELAY, 2, SetTravelSpeed(0.4)),
    Order(17.0, Link.RIVAL, 2, Stop()),
    RequestAuthority(18.0, RIVAL, Act.REQUEST),
    RequestAuthority(19.0, RIVAL, Act.TAKE),
    Order(19.5, Link.DIRECT, 3, SetTravelSpeed(0.2)),
    Kill(20.0, "executive", 1.0),
    Order(23.0, Link.RIVAL, 3, SetTravelSpeed(0.3)),
    RequestAuthority(24.0, RIVAL, Act.HAND_OVER),
    RequestAuthority(25.0, "direct", Act.REQUEST),
    Kill(26.0, "direct", 5.0),
    RequestAuthority(45.0, RIVAL, Act.REQUEST),
    RequestAuthority(47.0, RIVAL, Act.RELEASE),
)


def test_the_authority_passes_on_over_kills() -> None:
    assert not played(*PASSED_ON).findings


LENT: tuple[Deed, ...] = (
    RequestAuthority(15.0, "direct", Act.REQUEST),
    Order(16.0, Link.RELAY, 1, SetTravelSpeed(0.2)),
    RequestAuthority(17.0, "direct", Act.LEND),
    Order(18.0, Link.RELAY, 2, SetTravelSpeed(0.3)),
    Kill(19.0, "executive", 1.0),
    Order(22.0, Link.RELAY, 3, SetTravelSpeed(0.4)),
    RequestAuthority(25.0, RIVAL, Act.TAKE),
    Order(26.0, Link.RELAY, 4, SetTravelSpeed(0.2)),
)


def test_the_relay_commands_while_the_orbiter_holds_it() -> None:
    with player(Storm("lent", replace(CALM, authority_needed=True), LENT)) as playing:
        assert not playing.play().findings
        ends = playing.grounds["moe"].journal.ends
    assert [each for end in ends.values() for each in end] == [
        "REJECTED",
        "EXECUTED",
        "EXECUTED",
        "REJECTED",
    ]


def test_a_command_without_it_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    def judge(*_: object) -> None:
        return None

    monkeypatch.setattr(Authority, "check_command", judge)
    found = {finding.what for finding in played(*PASSED_ON).findings}
    assert found == {"a command was accepted without the authority"}


MOCUP_WITHOUT: tuple[Deed, ...] = (
    RequestAuthority(15.0, "direct", Act.REQUEST),
    Order(16.0, Link.RELAY, 1, MoveForward(0.2)),
)


@pytest.mark.parametrize("planted", [False, True])
def test_a_command_to_the_brick_without_it_is_found(
    planted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if planted:
        monkeypatch.setattr(RelayAuthority, "refusal_text", lambda *_: "")
    storm = Storm("authority", replace(MOCUP, authority_needed=True), MOCUP_WITHOUT)
    found = {finding.what for finding in play(storm).findings}
    assert found == ({"the brick was given a command without the authority"} if planted else set())


def test_a_grant_that_is_reported_and_not_written_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    def retain(*_: object) -> None:
        return None

    monkeypatch.setattr(AuthorityRecord, "save", retain)
    found = {finding.what for finding in played(*PASSED_ON).findings}
    assert "an operator was told of a grant that is not on the disk" in found
