"""Attacks on stops and authority by the relay, from the orbiter's MRS to the executive's topics."""

import asyncio
from dataclasses import replace
from pathlib import Path

import pytest

from adapters.bundle import DTN_EPOCH_UTC_MS, BundleAgent, ContactOverride
from adapters.mal import MalError
from adapters.mops import CommandConditions, conditions_of, decode, messages_in
from adapters.mops.codec import MAX_MESSAGE_OCTETS
from adapters.mrs.ground import MrsClient
from adapters.relay.orbiter.record import MAX_AUTHORITIES, RoverRecord
from adapters.relay.rover.bridge import MAX_FUTURE_STOP_S, CreationTime, LastStop
from executive.commands import (
    Command,
    ExecuteAction,
    Mode,
    MoveForward,
    OnlyAt,
    Precondition,
    Resume,
    SetTravelSpeed,
)
from executive.commands.catalogue import Request, Stop
from executive.settings import AuthoritySettings, load_settings
from executive.values.clock import ManualClock
from executive.values.reasons import Reason
from executive.values.reports import Identity, Stage
from tests.relay.orbiter.sky import DICTIONARY, Clock, Sky, eclipse, ground, landed, orbiting
from tests.relay.rover.ends import ROVER, Ends, octets, until
from tests.relay.rover.relayed_bench import RelayedBench, request_message
from tests.support.requested_authority import RequestedAuthority
from tests.support.timed_system import TimedSystem

WAITING = 100


async def send(agent: BundleAgent, request: Request, number: int) -> None:
    stop = isinstance(request, Stop)
    await agent.send(ROVER, octets(request_message(request, number)), expedited=stop)


def published(ends: Ends, *, overtaken: bool) -> set[int | None]:
    """Return the numbers of the commands that were published with, or without, the mark."""
    messages = messages_in("".join(ends.rover.commands), pytest.fail)
    return {m.moe_inputs_id for m in messages if (m.outputs[3:] == ("True",)) == overtaken}


@pytest.mark.at_length
def test_aboard_a_stop_overtakes_what_waits_which_is_marked_and_left_to_the_executive(
    tmp_path: Path,
) -> None:
    ends = Ends(tmp_path)
    ends.rover.confirms = False

    async def session() -> None:
        async with ends.orbiter() as orbiter:
            for _ in range(WAITING):
                await orbiter.send(ROVER, b"nothing that anybody reads")
            for number in range(1, WAITING):
                await send(orbiter, MoveForward(1.0), number)
            await send(orbiter, Resume(), WAITING)
            await until(lambda: bool(ends.rover.commands))
            both = octets(
                request_message(Resume(), WAITING + 3), request_message(Stop(), WAITING + 1)
            )
            await orbiter.send(ROVER, both, expedited=True)
            await until(lambda: bool(ends.rover.stops))
            ends.rover.commands.clear()
            await until(lambda: published(ends, overtaken=True) != set())

    link = ends.link()
    link.start()
    asyncio.run(session())
    assert ends.rover.stops == [str(request_message(Stop(), WAITING + 1))]
    assert published(ends, overtaken=False) == set()
    link.close()
    ends.rover.confirms = True
    ends.rover.commands.clear()
    waited = {*range(1, WAITING + 1), WAITING + 3}

    async def after_a_restart() -> None:
        async with ends.orbiter() as orbiter:
            await until(lambda: published(ends, overtaken=True) == waited)
            await send(orbiter, Resume(), WAITING + 2)
            await until(
                lambda: ends.rover.commands[-1:] == [str(request_message(Resume(), WAITING + 2))]
            )

    again = ends.link()
    again.start()
    asyncio.run(after_a_restart())
    again.close()
    assert published(ends, overtaken=True) == waited
    assert published(ends, overtaken=False) == {WAITING + 2}
    assert [m for m in ends.received if m.outputs[:1] == ("REJECTED",)] == []


@pytest.mark.parametrize(
    ("source", "number"), [("MOE", 1), ("MOE", 0), ("", 7), ("no name", 7), ("MOE", 2**63)]
)
async def test_at_the_orbiter_a_stop_goes_up_before_all_else_under_any_name_and_number(
    tmp_path: Path, source: str, number: int
) -> None:
    clock = Clock()
    async with orbiting(Sky(tmp_path, "jackal"), clock, eclipse(clock)) as (relay, _):
        (rover,) = relay.rovers.values()
        await rover.submit(Command(Identity("MOE", 1), MoveForward(1.0), "direct"))
        with pytest.raises(MalError):
            await rover.submit(Command(Identity(source, number), Stop(), "direct"))
        stop, _ = (decode(each.payload) for each in relay.agent.queued(rover.settings.endpoint))
        assert DICTIONARY.is_stop(stop)
        assert rover.record.outstanding.unanswered(1e12, 0.0, True, 10) == []


async def test_at_the_orbiter_a_stop_goes_up_where_nothing_can_be_written_down(
    tmp_path: Path,
) -> None:
    async with orbiting(Sky(tmp_path, "jackal")) as (relay, _):
        (rover,) = relay.rovers.values()
        rover.record.ledger.rows("PRAGMA query_only = ON")
        for number in (1, 1, 2):
            with pytest.raises(MalError, match="was uplinked"):
                await rover.submit(Command(Identity("MOE", number), Stop(), "direct"))
        assert relay.agent.health().queued == 3
        rover.record.ledger.rows("PRAGMA query_only = OFF")


@pytest.mark.parametrize(("octets_left", "refused"), [(60, 0), (0, 1)])
def test_aboard_a_command_too_long_to_be_answered_or_marked_ends_nothing(
    tmp_path: Path, octets_left: int, refused: int
) -> None:
    """A rover-relay that ended would read the bundle again at its next start, and end again."""
    ends = Ends(tmp_path)
    short = str(request_message(MoveForward(1.0), 2))
    long = short.replace("MOE", "x" * (MAX_MESSAGE_OCTETS - octets_left - len(short) + len("MOE")))

    async def session() -> None:
        async with ends.orbiter() as orbiter:
            await orbiter.send(ROVER, (long + str(request_message(Stop(), 3))).encode())
            await send(orbiter, Resume(), 4)
            # Either bundle may arrive first, and both may be published as one string.
            await until(lambda: len(passed_on()) + link.refused == 2 or not link.alive)

    def passed_on() -> set[int | None]:
        return published(ends, overtaken=True) | published(ends, overtaken=False)

    link = ends.link()
    link.start()
    asyncio.run(session())
    assert link.alive
    assert ends.rover.stops == [str(request_message(Stop(), 3))]
    assert link.refused == refused
    link.close()


STOP = str(request_message(Stop(), 7))


@pytest.mark.parametrize(
    "text",
    [
        STOP,
        STOP.replace("|7|", "||"),
        STOP.replace("|7|", "|0|"),
        STOP.replace("MOE", "plan:survey"),
        STOP.replace("MOE", "x" * 300),
        STOP.replace("MOE", "x" * 4000),
        STOP.replace("|STOP|", "|HALT|"),
        STOP.replace("|STOP||", "|STOP|now,or,never|"),
        STOP.replace("||False", "|999|False"),
        STOP.replace("||False", "|a,b|False"),
        STOP.replace("||False|False|7", "||False|False|1"),
    ],
)
def test_aboard_a_string_that_requests_a_stop_stops_despite_its_other_content(
    tmp_path: Path, text: str
) -> None:
    with RelayedBench(tmp_path) as bench:
        bench.receive(str(request_message(SetTravelSpeed(0.5), 1)))
        bench.receive(text)
        assert bench.executive.mode is Mode.STOPPED


def test_aboard_a_string_too_long_for_an_answer_does_not_block_others(
    tmp_path: Path,
) -> None:
    long = str(request_message(MoveForward(1.0), 1)).replace("MOE", "x" * 4000)
    with RelayedBench(tmp_path) as bench:
        bench.receive(long + str(request_message(SetTravelSpeed(0.3), 2)))
        assert bench.executive.status.travel_speed_mps == pytest.approx(0.3)
        assert bench.executive.mode is Mode.IDLE


def test_aboard_commands_of_the_relay_need_the_authority_of_the_orbiter(tmp_path: Path) -> None:
    needed = AuthoritySettings(needed=True)
    settings = replace(load_settings("jackal"), authority=needed)
    with RelayedBench(tmp_path, settings) as bench:
        authority = RequestedAuthority(bench)
        authority.request("MOE")
        own = authority.state.epoch
        authority.hand_over("MOE", own, needed.relay)
        handed = authority.state.epoch
        for number, epoch in enumerate((None, own, handed), 1):
            request, identity = SetTravelSpeed(0.1 * number), Identity("MOE", number)
            bench.receive(
                str(DICTIONARY.command(request, identity, "JACKAL", CommandConditions(epoch)))
            )
        ends = [r for r in bench.received.reports if r.stage in (Stage.REJECTED, Stage.EXECUTED)]
        assert [r.reason for r in ends] == [Reason.NO_AUTHORITY, Reason.NO_AUTHORITY, None]
        wrong = str(request_message(SetTravelSpeed(0.5), 9))
        bench.receive(wrong.replace("||False", f"|{handed},1.0,2.0,3.0|False"))
        assert bench.executive.status.travel_speed_mps == pytest.approx(0.3)


@pytest.mark.at_length
@pytest.mark.parametrize("numbered", [True, False])
async def test_the_orbiter_commands_by_its_authority_for_its_grantor_alone(
    tmp_path: Path, numbered: bool
) -> None:
    sky = Sky(tmp_path, "jackal", numbered=numbered)
    async with (
        orbiting(sky) as (_, (station,)),
        landed(sky, "jackal") as far,
        await ground(station) as client,
        await ground(station, "MOE-2") as other,
    ):
        far.ledger = far.ledger if numbered else ""
        await client.run(client.command(MoveForward(1.0)))
        assert (await client.run(client.command(ExecuteAction("authority 7")))).executed
        await client.run(client.command(MoveForward(2.0)))
        await client.run(replace(client.command(MoveForward(3.0)), authority=9))
        await client.run(client.command(Stop()))
        await other.run(other.command(MoveForward(4.0)))
        assert (await client.run(client.command(ExecuteAction("authority none")))).executed
        await client.run(client.command(MoveForward(5.0)))
        assert [m.outputs for m in far.commands] == [(), ("7",), ("9",), (), (), ()]
        with pytest.raises(MalError):
            await client.submit(client.command(ExecuteAction("authority -1")))


async def test_only_the_grantor_revokes_or_replaces_the_authority_of_the_orbiter(
    tmp_path: Path,
) -> None:
    sky = Sky(tmp_path, "jackal")
    async with (
        orbiting(sky) as (_, (station,)),
        landed(sky, "jackal") as far,
        await ground(station) as client,
        await ground(station, "MOE-2") as other,
    ):
        await client.run(client.command(ExecuteAction("authority 7")))
        for order in ("authority none", "authority 9", "authority none"):
            assert (await other.run(other.command(ExecuteAction(order)))).executed
        await client.run(client.command(MoveForward(1.0)))
        await other.run(other.command(MoveForward(2.0)))
        assert [m.outputs for m in far.commands] == [("7",), ()]


def test_the_orbiter_remembers_the_authority_of_the_last_sources_only(tmp_path: Path) -> None:
    record = RoverRecord(tmp_path / "jackal.sqlite")
    for number in range(MAX_AUTHORITIES + 10):
        record.set_authority(number, f"MOE-{number}")
    assert record.authority("MOE-9") is None
    assert record.authority("MOE-10") == 10
    record.close()


async def test_in_clear_text_the_orbiter_takes_no_authority_where_others_reach_it(
    tmp_path: Path,
) -> None:
    sky = Sky(tmp_path, "jackal")
    async with orbiting(sky) as (_, (station,)), landed(sky, "jackal") as far:
        await station.close()
        await station.start("0.0.0.0", None, clear_text=True)
        uri = f"maltcp://127.0.0.1:{station.uri.port}/{station.uri.name}"
        async with await MrsClient.connect(uri, "MOE") as client:
            with pytest.raises(MalError, match="source names are not authenticated here"):
                await client.submit(client.command(ExecuteAction("authority 7")))
            await client.run(replace(client.command(MoveForward(1.0)), authority=9))
        assert [m.outputs for m in far.commands] == [("9",)]


@pytest.mark.parametrize("ahead_s", [-3600.0, 0.0, 60.0, 86_000.0])
def test_a_stop_of_a_clock_that_is_ahead_holds_later_commands_for_minutes_only(
    tmp_path: Path, ahead_s: float
) -> None:
    clock = ManualClock()
    now_ms = round(clock.utc_s() * 1000) - DTN_EPOCH_UTC_MS
    stop: CreationTime = (now_ms + round(ahead_s * 1000), 0, 0)
    last = LastStop(tmp_path / "relay.stop", TimedSystem(clock.utc_s))
    last.add_stop(stop)
    last.save()
    for waited_s in (0.0, MAX_FUTURE_STOP_S - 1.0, 1.0, 86_400.0):
        clock.advance(waited_s)
        last = LastStop(tmp_path / "relay.stop", TimedSystem(clock.utc_s))
        before = (min(stop[0], now_ms) - 1, 0, 0)
        assert last.overtakes(before), "what was made before it, by either clock, never moves"
        assert not last.overtakes((stop[0], 1, 0)), "what the same clock makes after it is taken"
        later_ms = round(clock.utc_s() * 1000) - DTN_EPOCH_UTC_MS + 1
        held = ahead_s > 0.0 and clock.now_s() < MAX_FUTURE_STOP_S and later_ms < stop[0]
        assert last.overtakes((later_ms, 0, 0)) == held


def test_a_clock_that_is_set_back_holds_no_longer(tmp_path: Path) -> None:
    utc_s = [2e9]
    last = LastStop(tmp_path / "relay.stop", TimedSystem(lambda: utc_s[0]))
    ahead_ms = round(utc_s[0] * 1000) - DTN_EPOCH_UTC_MS + 86_000_000
    last.add_stop((ahead_ms, 0, 0))
    utc_s[0] -= 80_000.0
    later = (round(utc_s[0] * 1000) - DTN_EPOCH_UTC_MS + 2000, 0, 0)
    assert last.overtakes(later)
    utc_s[0] += MAX_FUTURE_STOP_S
    assert not last.overtakes(later)


async def test_a_stop_opens_a_contact_that_another_holds_closed(tmp_path: Path) -> None:
    sky = Sky(tmp_path, "jackal")
    async with (
        orbiting(sky) as (relay, (station,)),
        landed(sky, "jackal") as far,
        await ground(station) as client,
        await ground(station, "MOE-2") as other,
    ):
        assert (await other.run(other.command(ExecuteAction("contact down")))).executed
        await client.submit(client.command(Stop()))
        await until(lambda: [m.command for m in far.commands] == ["STOP"])
        (neighbour,) = relay.agent.health().neighbours
        assert neighbour.override is ContactOverride.BY_PLAN


def test_aboard_a_command_of_the_relay_does_not_outlive_its_lifetime(tmp_path: Path) -> None:
    with RelayedBench(tmp_path) as bench:
        now_s = bench.clock.utc_s()
        lifetimes = {1: (now_s, 5.0), 2: (now_s - 60.0, 5.0), 3: (now_s + 3600.0, 5.0)}
        for number, lifetime in lifetimes.items():
            request, identity = SetTravelSpeed(0.1 * number), Identity("MOE", number)
            bench.receive(
                str(
                    DICTIONARY.command(
                        request, identity, "JACKAL", CommandConditions(None, *lifetime)
                    )
                )
            )
        ends = [r for r in bench.received.reports if r.stage in (Stage.REJECTED, Stage.EXECUTED)]
        assert [r.reason for r in ends] == [None, Reason.EXPIRED, Reason.CREATED_IN_FUTURE]


def test_a_command_of_the_relay_has_its_precondition_aboard(tmp_path: Path) -> None:
    """One that cannot be read is refused; a stop acts with any."""
    with RelayedBench(tmp_path) as bench:

        def receive(request: Request, number: int, *only: str | int | None) -> None:
            conditions = CommandConditions(None, None, None, None, *only)  # type: ignore[arg-type]
            identity = Identity("MOE", number)
            bench.receive(str(DICTIONARY.command(request, identity, "JACKAL", conditions)))

        receive(MoveForward(1.0), 1, "1.0 0.0 0.3")
        assert bench.last(1).reason is Reason.PRECONDITION_POSE
        receive(MoveForward(1.0), 2, "0.0 0.0 0.3")
        assert bench.finish(2) is Stage.EXECUTED
        receive(MoveForward(1.0), 3, None, 1)
        assert bench.last(3).reason is Reason.PRECONDITION_COMMAND
        receive(MoveForward(1.0), 4, "here")
        assert bench.stages(4) == []
        assert "precondition: not X Y WITHIN" in str(bench.reported[-1])
        receive(Stop(), 5, "9.0 9.0 0.1", 77, "IDLE")
        assert bench.finish(5) is Stage.EXECUTED
        receive(Stop(), 6, "here")
        assert bench.finish(6) is Stage.EXECUTED


async def test_the_orbiter_passes_on_creation_time_and_lifetime_of_a_command(
    tmp_path: Path,
) -> None:
    sky = Sky(tmp_path, "jackal")
    async with orbiting(sky) as (relay, _), landed(sky, "jackal") as far:
        (rover,) = relay.rovers.values()
        made_s = Clock().utc_s()
        for number, created_s in enumerate((made_s, made_s + 3600.0), 1):
            identity = Identity("MOE", number)
            await rover.submit(Command(identity, MoveForward(1.0), "direct", created_s, 30.0))
        (*_, later) = relay.agent.queued(rover.settings.endpoint)
        assert later.expires_utc_s <= Clock().utc_s() + 30.0
        await until(lambda: len(far.commands) == 2)
        assert conditions_of(far.commands[0]) == CommandConditions(None, made_s, 30.0)
        only, identity = Precondition(OnlyAt(3.0, 2.0, 0.5), 1, Mode.IDLE), Identity("MOE", 3)
        await rover.submit(Command(identity, MoveForward(1.0), "direct", precondition=only))
        await until(lambda: len(far.commands) == 3)
        assert conditions_of(far.commands[2]).precondition == only
