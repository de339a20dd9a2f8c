"""One operator at a time commands: leases, hand-over, take-over, stale epochs, and stops of all."""

import asyncio
import json
import signal
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from adapters.mal import MalError
from adapters.mocup.brick.record import BrickRecord
from adapters.mops import RelayAuthority
from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import AuthorityStatus, Stage
from executive.commands import (
    ActivatePlan,
    Command,
    Mode,
    MoveForward,
    Request,
    SetTravelSpeed,
    Stop,
    SubmitPlan,
)
from executive.commands.lifecycle import Accepted, Rejected
from executive.core.authority import Authority, AuthorityRecord, AuthorityState
from executive.settings import AuthoritySettings, SettingsError, load_settings, structure
from executive.values.facts import ExternalAuthorityUse
from executive.values.geometry import STANDING
from executive.values.reasons import Figure, Reason, Refusal
from executive.values.reports import Identity
from tests.mrs.aboard import Aboard, raises, rover
from tests.mrs.test_command_command import INTERRUPTED, typed_in_process, wait_for
from tests.stress import authority_storm
from tests.support.kinematic import Bench
from tests.support.plans import plan
from tests.support.requested_authority import RequestedAuthority

pytestmark = pytest.mark.alike

RULES = AuthoritySettings(needed=True, lease_s=5.0, takeover_sources=("DIRECTOR",))
SETTINGS = replace(load_settings("jackal"), authority=RULES)


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    with Bench(tmp_path, SETTINGS) as bench:
        yield bench


def granted(found: AuthorityState | Refusal) -> int:
    assert isinstance(found, AuthorityState), found
    return found.epoch


def refusal(found: AuthorityState | Refusal) -> Refusal:
    assert isinstance(found, Refusal), found
    return found


class Operator:
    """Sends commands of one source to a bench, by whatever link, under numbers of its own."""

    def __init__(self, bench: Bench, source: str, link: str = "direct") -> None:
        self._bench, self._source, self._link = bench, source, link
        self._number = 0

    def send(self, request: Request, epoch: int | None) -> Refusal | None:
        self._number += 1
        identity = Identity(self._source, self._number)
        answer = self._bench.send(Command(identity, request, self._link, authority=epoch))
        assert isinstance(answer, Accepted | Rejected)
        return answer.refusal if isinstance(answer, Rejected) else None


def test_without_authority_nothing_is_commanded_but_a_stop(bench: Bench) -> None:
    refused = Operator(bench, "MOE").send(MoveForward(1.0), None)
    assert refused is not None
    assert refused.reason is Reason.NO_AUTHORITY
    assert "it is free; request it first" in refused.text
    epoch = granted(RequestedAuthority(bench).request("MOE"))
    assert Operator(bench, "MOE-2").send(MoveForward(1.0), None) is not None
    other = Operator(bench, "MOE-3")
    stolen = other.send(MoveForward(1.0), epoch)
    assert stolen is not None
    assert "MOE-3 does not hold authority 1: MOE holds it for another 5 s" in stolen.text
    assert [figure.name for figure in stolen.figures] == ["epoch", "lease left"]
    holder = Operator(bench, "HOLDER")
    RequestedAuthority(bench).hand_over("MOE", epoch, "HOLDER")
    assert holder.send(MoveForward(5.0), epoch + 1) is None
    bench.run(1.0)
    assert bench.rover.velocity != STANDING
    assert other.send(Stop(), None) is None
    assert bench.rover.velocity == STANDING


@pytest.mark.at_length
@pytest.mark.parametrize("claim", [None, 0, -1, 7, 1 << 62])
def test_a_stop_acts_under_any_claimed_authority(bench: Bench, claim: int | None) -> None:
    epoch = granted(RequestedAuthority(bench).request("MOE"))
    assert Operator(bench, "MOE").send(MoveForward(5.0), epoch) is None
    bench.run(1.0)
    assert Operator(bench, "NOBODY").send(Stop(), claim) is None
    assert bench.rover.velocity == STANDING
    assert bench.executive.mode is Mode.STOPPED


def test_a_silent_holder_loses_it_and_returns_under_a_new_epoch(bench: Bench) -> None:
    authority, moe = RequestedAuthority(bench), Operator(bench, "MOE")
    first = granted(authority.request("MOE"))
    for _ in range(3):
        bench.run(4.0)
        assert moe.send(SetTravelSpeed(0.5), first) is None, "each command renews the lease"
    bench.run(5.1)
    late = moe.send(SetTravelSpeed(0.5), first)
    assert late is not None
    assert late.reason is Reason.NO_AUTHORITY
    assert "the authority of MOE has expired" in [r.text for r in bench.received.reports]
    second = granted(authority.request("MOE-2"))
    third = granted(authority.hand_over("MOE-2", second, "MOE"))
    assert first < second < third
    assert moe.send(SetTravelSpeed(0.5), first) is not None, "the old epoch stays stale"
    assert moe.send(SetTravelSpeed(0.5), third) is None


def test_a_request_is_announced_to_all_and_only_once_in_a_lease(bench: Bench) -> None:
    authority = RequestedAuthority(bench)
    granted(authority.request("MOE"))
    for source in ("MOE-2", "MOE-3", "MOE-2"):
        assert refusal(authority.request(source)).reason is Reason.NO_AUTHORITY
    assert authority.state.requested_by == "MOE-2"
    bench.run(0.1)
    reported = [r.text for r in bench.received.reports]
    assert reported == [
        "MOE holds the authority (epoch 1)",
        "MOE-2 requests the authority that MOE holds",
    ]


def test_a_repeated_request_renews_the_lease_and_so_does_commanding_by_it(bench: Bench) -> None:
    authority, moe = RequestedAuthority(bench), Operator(bench, "MOE")
    epoch = granted(authority.request("MOE"))
    bench.run(4.0)
    assert granted(authority.request("MOE")) == epoch
    bench.run(4.0)
    bench.executive.observe(ExternalAuthorityUse(epoch + 1))
    bench.executive.observe(ExternalAuthorityUse(epoch))
    bench.clock.advance(4.9)
    assert moe.send(SetTravelSpeed(0.5), epoch) is None
    bench.executive.observe(ExternalAuthorityUse(epoch + 1))
    bench.clock.advance(RULES.lease_s)
    assert moe.send(SetTravelSpeed(0.4), epoch) is not None, "its time is up"
    bench.executive.observe(ExternalAuthorityUse(epoch))
    bench.run(0.1)
    assert "the authority of MOE has expired" in [r.text for r in bench.received.reports]
    assert moe.send(SetTravelSpeed(0.4), epoch) is not None


def test_a_request_that_lasts_beyond_a_lease_is_announced_again(bench: Bench) -> None:
    authority, moe = RequestedAuthority(bench), Operator(bench, "MOE")
    epoch = granted(authority.request("MOE"))
    for _ in range(5):
        assert refusal(authority.request("MOE-2")).reason is Reason.NO_AUTHORITY
        bench.clock.advance(RULES.lease_s / 2)
        assert moe.send(SetTravelSpeed(0.5), epoch) is None
    requested = "MOE-2 requests the authority that MOE holds"
    assert [r.text for r in bench.received.reports].count(requested) == 3


def test_a_released_authority_is_free_and_only_its_holder_releases_it(bench: Bench) -> None:
    authority, moe = RequestedAuthority(bench), Operator(bench, "MOE")
    epoch = granted(authority.request("MOE"))
    for source, of in (("MOE-2", epoch), ("MOE", epoch + 1)):
        assert refusal(authority.release(source, of)).reason is Reason.NO_AUTHORITY
        assert refusal(authority.hand_over(source, of, "MOE-2")).reason is Reason.NO_AUTHORITY
        assert moe.send(SetTravelSpeed(0.5), epoch) is None
    assert granted(authority.release("MOE", epoch)) == epoch
    refused = moe.send(SetTravelSpeed(0.5), epoch)
    assert refused is not None
    assert "it is free" in refused.text
    assert refused.figures == (Figure("epoch", epoch),)
    assert granted(authority.take("MOE-2")) == epoch + 1
    assert granted(authority.take("MOE-2")) == epoch + 1, "it has it"
    given = granted(authority.hand_over("MOE-2", epoch + 1, "MOE", RULES.max_lease_s))
    bench.clock.advance(RULES.max_lease_s - 0.01)
    assert moe.send(SetTravelSpeed(0.5), given) is None


def test_only_permitted_sources_take_it(bench: Bench) -> None:
    authority = RequestedAuthority(bench)
    epoch = granted(authority.request("MOE"))
    assert "MOE holds it" in refusal(authority.take("MOE-2")).text
    assert granted(authority.take("DIRECTOR")) == epoch + 1
    assert Operator(bench, "MOE").send(SetTravelSpeed(0.5), epoch) is not None
    assert "MOE does not hold" in refusal(authority.hand_over("MOE", epoch, "MOE-2")).text
    assert "MOE does not hold" in refusal(authority.release("MOE", epoch)).text
    assert authority.state.holder == "DIRECTOR"


@pytest.mark.alike
@pytest.mark.parametrize("name", ["", "x" * 257, "a\nb", "\x1b[2J", "plan:survey"])
def test_it_is_not_held_under_an_invalid_name(bench: Bench, name: str) -> None:
    authority = RequestedAuthority(bench)
    assert refusal(authority.request(name)).reason is Reason.BAD_IDENTIFIER
    epoch = granted(authority.request("MOE"))
    assert refusal(authority.request(name)).reason is Reason.BAD_IDENTIFIER
    assert refusal(authority.hand_over("MOE", epoch, name)).argument == 2
    assert authority.state.holder == "MOE"


@pytest.mark.parametrize("lease_s", [0.0, -1.0, 1e9, float("nan"), float("inf")])
def test_a_lease_is_bounded(bench: Bench, lease_s: float) -> None:
    authority = RequestedAuthority(bench)
    epoch = granted(authority.request("MOE"))
    refused = refusal(authority.hand_over("MOE", epoch, "MOPS", lease_s))
    assert (refused.reason, refused.argument) == (Reason.OUT_OF_RANGE, 3)


def test_the_holder_and_the_epochs_outlive_a_kill(bench: Bench) -> None:
    first = granted(RequestedAuthority(bench).request("MOE"))
    bench.crash()
    assert Operator(bench, "MOE").send(SetTravelSpeed(0.5), first) is None
    assert "MOE holds it" in refusal(RequestedAuthority(bench).request("MOE-2")).text
    second = granted(RequestedAuthority(bench).take("DIRECTOR"))
    RequestedAuthority(bench).release("DIRECTOR", second)
    bench.crash()
    assert granted(RequestedAuthority(bench).request("MOE-2")) == second + 1


def test_on_a_full_disk_it_does_not_pass_on(bench: Bench) -> None:
    authority = RequestedAuthority(bench)
    epoch = granted(authority.request("MOE"))
    bench.fill_disk()
    assert refusal(authority.take("DIRECTOR")).reason is Reason.LEDGER_FAILED
    bench.fill_disk(full=False)
    assert Operator(bench, "MOE").send(SetTravelSpeed(0.5), epoch) is None
    assert granted(authority.take("DIRECTOR")) > epoch + 1, "the number tried before is not reused"


def test_a_change_refused_by_a_full_disk_has_not_happened_after_a_kill(bench: Bench) -> None:
    authority = RequestedAuthority(bench)
    epoch = granted(authority.request("MOE"))
    bench.fill_disk()
    assert refusal(authority.take("DIRECTOR")).reason is Reason.LEDGER_FAILED
    bench.fill_disk(full=False)
    assert Operator(bench, "MOE").send(SetTravelSpeed(0.5), epoch) is None
    bench.crash()
    assert Operator(bench, "MOE-1").send(SetTravelSpeed(0.5), epoch) is not None
    assert bench.executive.authority.state.holder == "MOE"
    assert bench.executive.authority.state.epoch == epoch


def test_the_relay_commands_by_the_authority_of_the_orbiter_alone(bench: Bench) -> None:
    authority, relayed = RequestedAuthority(bench), Operator(bench, "MOE", link="relay")
    own = granted(authority.request("MOE"))
    refused = relayed.send(SetTravelSpeed(0.5), own)
    assert refused is not None
    assert "MOPS does not hold authority 1: MOE holds it" in refused.text
    handed = granted(authority.hand_over("MOE", own, "MOPS", 3600.0))
    bench.run(60.0)
    assert relayed.send(SetTravelSpeed(0.5), handed) is None
    other = Operator(bench, "MOE-2", link="relay").send(SetTravelSpeed(0.5), handed)
    assert other is not None
    assert "MOE-2 is not MOE, the grantor: MOPS holds it" in other.text
    bench.crash()
    assert Operator(bench, "MOE-3", link="relay").send(SetTravelSpeed(0.5), handed) is not None
    assert relayed.send(Stop(), None) is None


def test_the_commands_of_a_plan_have_the_authority_of_its_activation(bench: Bench) -> None:
    epoch = granted(RequestedAuthority(bench).request("MOE"))
    moe = Operator(bench, "MOE")
    ahead = plan('<moveForward distance="1" deadline_s="60"/>')
    assert Operator(bench, "MOE-2").send(SubmitPlan(ahead), None) is not None
    for request in (SubmitPlan(ahead), ActivatePlan("survey")):
        assert moe.send(request, epoch) is None
    bench.run(10.0)
    assert bench.rover.pose.x_m == pytest.approx(1.0, abs=0.05)


def test_where_it_is_not_needed_only_a_false_claim_is_refused(tmp_path: Path) -> None:
    with Bench(tmp_path) as bench:
        assert Operator(bench, "MOE").send(SetTravelSpeed(0.5), None) is None
        refused = Operator(bench, "MOE-2").send(SetTravelSpeed(0.5), 3)
        assert refused is not None
        assert refused.reason is Reason.NO_AUTHORITY


@pytest.mark.parametrize(
    ("message", "by_others", "needed"),
    [(None, True, True), (None, False, False), (False, True, False), (True, False, True)],
)
def test_it_is_needed_if_others_reach_the_rover_unless_the_settings_permit_them(
    message: bool | None, by_others: bool, needed: bool
) -> None:
    settings = replace(SETTINGS, authority=replace(RULES, needed=message))
    assert settings.for_access(by_others=by_others).authority == replace(RULES, needed=needed)


def test_settings_with_a_lease_that_is_none_are_refused() -> None:
    with pytest.raises(SettingsError, match="lease_s must be above 0"):
        structure({"lease_s": 0}, AuthoritySettings, "jackal.yaml")


@pytest.mark.at_length
@pytest.mark.parametrize("brick", [False, True])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_random_interleavings_never_have_two_holders(seed: int, brick: bool) -> None:
    figures = authority_storm.measure(SETTINGS, 200, seed, print, brick=brick)
    assert [figure.name for figure in figures if not figure.met] == []


@pytest.mark.at_length
@pytest.mark.parametrize(
    ("cls", "name", "broken", "found"),
    [
        (Authority, "check_command", lambda *_: None, "commands executed without authority"),
        (Authority, "_renew", lambda _: None, "commands of the holder refused"),
        (AuthorityRecord, "save", lambda *_: None, "holders beside the one there is"),
        (Authority, "renew_lease", lambda *_: None, "commands of the holder refused"),
        (RelayAuthority, "refusal_text", lambda *_: "", "commands executed without authority"),
        (BrickRecord, "authority", lambda _: None, "commands of the holder refused"),
    ],
)
def test_an_authority_that_fails_is_found_out(
    monkeypatch: pytest.MonkeyPatch, cls: type, name: str, broken: object, found: str
) -> None:
    monkeypatch.setattr(cls, name, broken)
    figures = authority_storm.measure(SETTINGS, 300, 1, lambda _: None, brick=True)
    assert f"authority: {found}" in [figure.name for figure in figures if not figure.met]


@pytest.fixture
def guarded(tmp_path: Path) -> Iterator[Aboard]:
    """Give a rover on a real socket whose commands need the authority."""
    aboard = Aboard(tmp_path, authority=replace(RULES, lease_s=600.0))
    aboard.runs = True
    yield aboard
    aboard.runs = False
    aboard.close()


@pytest.mark.at_length
def test_a_session_holds_its_requested_authority_and_another_is_notified(guarded: Aboard) -> None:
    async def session(first: MrsClient) -> None:
        arrived = first.notifications()
        refused = await first.run(first.command(MoveForward(0.1)))
        assert refused.reports[-1].reason is Reason.NO_AUTHORITY
        held = await first.authority.request()
        assert (await first.run(first.command(MoveForward(0.1)))).executed
        async with await MrsClient.connect(guarded.uri, "MOE-2") as second:
            with raises(2):
                await second.authority.request()
            assert (await second.authority.status()).holder == "MOE"
            stale = replace(second.command(MoveForward(0.1)), authority=held.epoch)
            reported = (await second.run(stale)).refusal
            assert reported is not None
            assert "MOE holds it for another" in reported.extra.value
            assert (await second.run(second.command(Stop()))).executed
            await first.authority.hand_over("MOE-2")
            assert (await second.authority.request()).epoch == held.epoch + 1
            assert first.authority.epoch is None
        texts = []
        async for received in arrived:
            texts.append(received.report.text)
            if "handed the authority over to MOE-2" in texts[-1]:
                break
        assert "MOE-2 requests the authority that MOE holds" in texts

    guarded.ground(session)


def test_a_session_renews_its_lease_while_it_lasts(tmp_path: Path) -> None:
    aboard = Aboard(tmp_path, authority=replace(RULES, lease_s=0.3))

    async def session(client: MrsClient) -> None:
        held = await client.authority.request()
        for _ in range(5):
            aboard.run(0.2)
            while (status := await client.authority.status()).leaseLeft < 0.29:
                assert (status.holder, status.epoch) == ("MOE", held.epoch)
                await asyncio.sleep(0.01)
        async with await MrsClient.connect(aboard.uri, "DIRECTOR") as second:
            await second.authority.take()
            await client.authority.wait_lost()
            assert client.authority.epoch is None

    try:
        aboard.ground(session)
    finally:
        aboard.close()


def test_endless_requests_are_slowed_and_changes_do_not_fill_the_record(
    guarded: Aboard,
) -> None:
    async def pass_on(client: MrsClient) -> None:
        for _ in range(20):
            await client.authority.request()
            await client.authority.release()

    async def session(client: MrsClient) -> None:
        with pytest.raises(MalError, match="at most 10 a second"):
            await pass_on(client)
        assert (await client.authority.status()).epoch <= 10

    guarded.ground(session)
    foreign = "SELECT count(*) FROM foreign_reports"
    ((stored,),) = guarded.do(lambda bench: bench.ledger.rows(foreign))
    assert stored == guarded.do(lambda bench: len(bench.received.reports)), "the first to be pruned"


def test_the_command_line_requests_it_and_prints_the_holder(guarded: Aboard) -> None:
    guarded.runs = False
    to = ("--to", guarded.uri)
    assert rover("authority", "status", *to).output == "authority free\n"
    done = rover("command", *to, "--no-wait", "setTravelSpeed", "0.5")
    assert (done.exit_code, done.output.splitlines()[-1]) == (0, "acknowledged")
    other = rover("command", *to, "--source", "MOE-2", "--no-wait", "setTravelSpeed", "0.4")
    assert other.exit_code == 1
    assert "MOE holds it for another" in other.output
    assert "rover authority request" in other.output
    stop = rover("command", *to, "--source", "MOE-2", "--no-wait", "stop")
    assert stop.exit_code == 0
    handed = rover("authority", "hand-over", "MOPS", "--lease", "60", *to)
    assert "MOPS holds the authority, epoch 2, lease 60 s" in handed.output
    assert "MOPS holds the authority" in rover("status", *to).output
    status = json.loads(rover("status", "--json", *to).output)["authority"]
    assert (status["holder"], status["needed"]) == ("MOPS", True)
    assert rover("authority", "release", *to).exit_code == 1
    took = rover("authority", "take", "--source", "DIRECTOR", *to)
    assert "DIRECTOR holds the authority, epoch 3" in took.output
    assert rover("authority", "release", "--source", "DIRECTOR", *to).exit_code == 0
    assert json.loads(rover("authority", "status", "--json", *to).output)["holder"] is None


@pytest.mark.at_length
def test_an_operator_holds_it_until_ctrl_c(guarded: Aboard) -> None:
    guarded.runs = False
    holding = typed_in_process("authority", "request", "--hold", "--to", guarded.uri)
    wait_for(holding, "MOE holds the authority")
    holding.send_signal(signal.SIGINT)
    holding.communicate()
    assert holding.returncode == INTERRUPTED
    assert rover("authority", "status", "--to", guarded.uri).output.startswith("authority free")


@pytest.mark.at_length
def test_an_operator_that_holds_it_is_notified_of_a_takeover(tmp_path: Path) -> None:
    aboard = Aboard(tmp_path, authority=replace(RULES, lease_s=0.3))
    try:
        holding = typed_in_process("authority", "request", "--hold", "--to", aboard.uri)
        wait_for(holding, "MOE holds the authority")
        assert rover("authority", "take", "--source", "DIRECTOR", "--to", aboard.uri).exit_code == 0
        _, errors = holding.communicate()
        assert holding.returncode == 1
        assert "authority lost: DIRECTOR holds the authority" in errors
    finally:
        aboard.close()


def test_a_stop_needs_no_round_trip_for_the_authority(
    guarded: Aboard, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def requested(_: object) -> AuthorityStatus:
        raise AssertionError("a stop asked for the authority")

    monkeypatch.setattr("adapters.mrs.ground.session.SessionAuthority.status", requested)
    result = rover("command", "--to", guarded.uri, "--json", "stop")
    assert result.exit_code == 0
    assert Stage.EXECUTED.name in result.output
