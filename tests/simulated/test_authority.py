"""Two operators with the authority in the simulated world; each check is shown to fail."""

from dataclasses import replace

import pytest

from adapters.mops import RelayAuthority
from executive.commands import MoveForward, SetTravelSpeed, Stop
from executive.core.authority import Authority
from executive.record import AuthorityRecord
from tests.simulated.asks import RIVAL, Act, AskAuthority
from tests.simulated.deeds import Deed, Kill, Link, Order, Storm
from tests.simulated.situations import CALM, MOCUP
from tests.simulated.storm import Played, play, player


def played(*deeds: Deed) -> Played:
    return play(Storm("authority", replace(CALM, authority_needed=True), deeds))


PASSED_ON: tuple[Deed, ...] = (
    AskAuthority(15.0, "direct", Act.REQUEST),
    Order(16.0, Link.DIRECT, 1, SetTravelSpeed(0.2)),
    Order(16.0, Link.RIVAL, 1, SetTravelSpeed(0.3)),
    Order(16.0, Link.RELAY, 2, SetTravelSpeed(0.4)),
    Order(17.0, Link.RIVAL, 2, Stop()),
    AskAuthority(18.0, RIVAL, Act.REQUEST),
    AskAuthority(19.0, RIVAL, Act.TAKE),
    Order(19.5, Link.DIRECT, 3, SetTravelSpeed(0.2)),
    Kill(20.0, "executive", 1.0),
    Order(23.0, Link.RIVAL, 3, SetTravelSpeed(0.3)),
    AskAuthority(24.0, RIVAL, Act.HAND_OVER),
    AskAuthority(25.0, "direct", Act.REQUEST),
    Kill(26.0, "direct", 5.0),
    AskAuthority(45.0, RIVAL, Act.REQUEST),
    AskAuthority(47.0, RIVAL, Act.RELEASE),
)


def test_the_authority_passes_on_over_kills() -> None:
    assert not played(*PASSED_ON).findings


LENT: tuple[Deed, ...] = (
    AskAuthority(15.0, "direct", Act.REQUEST),
    Order(16.0, Link.RELAY, 1, SetTravelSpeed(0.2)),
    AskAuthority(17.0, "direct", Act.LEND),
    Order(18.0, Link.RELAY, 2, SetTravelSpeed(0.3)),
    Kill(19.0, "executive", 1.0),
    Order(22.0, Link.RELAY, 3, SetTravelSpeed(0.4)),
    AskAuthority(25.0, RIVAL, Act.TAKE),
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
    AskAuthority(15.0, "direct", Act.REQUEST),
    Order(16.0, Link.RELAY, 1, MoveForward(0.2)),
)


@pytest.mark.parametrize("planted", [False, True])
def test_a_command_to_the_brick_without_it_is_found(
    planted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if planted:
        monkeypatch.setattr(RelayAuthority, "fault", lambda *_: "")
    storm = Storm("authority", replace(MOCUP, authority_needed=True), MOCUP_WITHOUT)
    found = {finding.what for finding in play(storm).findings}
    assert found == ({"the brick was given a command without the authority"} if planted else set())


def test_a_grant_that_is_told_and_not_written_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    def keep(*_: object) -> None:
        return None

    monkeypatch.setattr(AuthorityRecord, "save", keep)
    found = {finding.what for finding in played(*PASSED_ON).findings}
    assert "an operator was told of a grant that is not on the disk" in found
