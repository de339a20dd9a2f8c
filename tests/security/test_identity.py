"""With TLS nobody speaks as another: a certificate names the source. A stop acts all the same."""

import asyncio
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from adapters.mal import Certificates, Consumer, MalError, StandardError
from adapters.mrs.cli.plan_command import PlanLines
from adapters.mrs.cli.terminal import echo_line, print_table
from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import (
    AreaError,
    describe_error,
    mrs_specification,
    with_text,
)
from adapters.mrs.transport import TransportSettings
from executive.commands import Command, Mode, MoveForward, SetTravelSpeed, Stop
from executive.commands.lifecycle import Rejected
from executive.settings import AuthoritySettings
from executive.values.geometry import STANDING
from executive.values.reasons import Reason
from executive.values.reports import Identity, PlanStatus, PlanUpdate
from tests.mrs.aboard import Aboard, raises, rover
from tests.relay.orbiter.sky import Sky, orbiting
from tests.support.certificates import certified, options
from tests.support.kinematic import Bench

UNNAMED = "MOE\x1b[2J"


@pytest.fixture(scope="module")
def ends(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Certificates]:
    return certified(tmp_path_factory.mktemp("ends"), "rover", "MOE", "MOE-2", UNNAMED)


@pytest.fixture
def secured(tmp_path: Path, ends: dict[str, Certificates]) -> Iterator[Aboard]:
    """Give a rover that asks for certificates."""
    aboard = Aboard(tmp_path, terms=TransportSettings(certificates=ends["rover"]))
    yield aboard
    aboard.close()


async def connected(rover: Aboard, of: Certificates, source: str | None = None) -> MrsClient:
    return await MrsClient.connect(rover.uri, source, terms=TransportSettings(certificates=of))


def test_a_client_speaks_under_the_name_of_its_certificate(
    secured: Aboard, ends: dict[str, Certificates]
) -> None:
    async def session() -> None:
        async with await connected(secured, ends["MOE-2"]) as client:
            await client.submit(client.command(SetTravelSpeed(0.5), command_id=7))
            secured.run(0.1)
            (first, *_) = await client.get_notifications(command_id=7)
            assert (client.source, first.report.identity) == ("MOE-2", Identity("MOE-2", 7))

    asyncio.run(session())


@pytest.mark.parametrize("source", ["MOE-2", "rover", UNNAMED])
def test_a_client_under_another_name_is_refused_and_nothing_is_recorded(
    secured: Aboard, ends: dict[str, Certificates], source: str
) -> None:
    async def session() -> None:
        async with await connected(secured, ends[source], "MOE") as client:
            with raises(1, 0):
                await client.submit(client.command(SetTravelSpeed(0.5), command_id=7))
            assert await client.get_notifications(command_id=7) == ()
            with raises(2):
                await client.authority.request()
        async with await connected(secured, ends["MOE"]) as client:
            assert (await client.authority.status()).holder is None
            await client.submit(client.command(SetTravelSpeed(0.4), command_id=7))

    asyncio.run(session())
    reported = secured.do(lambda bench: [r for r in bench.received.reports if r.identity is None])
    assert [report.reason for report in reported] == [Reason.BAD_IDENTIFIER]


@pytest.mark.at_length
@pytest.mark.parametrize("source", ["MOE-2", UNNAMED])
def test_a_stop_under_the_name_of_another_acts(
    secured: Aboard, ends: dict[str, Certificates], source: str
) -> None:
    async def session() -> None:
        async with await connected(secured, ends["MOE"]) as client:
            await client.submit(client.command(MoveForward(10.0)))
            secured.run(2.0)
            assert secured.do(lambda bench: bench.rover.velocity) != STANDING
        async with await connected(secured, ends[source], "MOE") as client:
            with pytest.raises(MalError, match=r"by its certificate.*stop") as raised:
                await client.submit(client.command(Stop()))
            assert raised.value.number == 2

    asyncio.run(session())
    assert secured.do(lambda bench: bench.rover.velocity) == STANDING
    assert secured.do(lambda bench: bench.executive.mode) is Mode.STOPPED


def test_a_repeat_under_the_name_of_another_is_no_repeat(tmp_path: Path) -> None:
    with Bench(tmp_path) as bench:
        mine = Command(Identity("MOE", 1), SetTravelSpeed(0.5), "direct", peer="MOE")
        bench.send(mine)
        reported = len(bench.received.reports)
        answer = bench.send(replace(mine, peer="MOE-2"))
        assert isinstance(answer, Rejected)
        assert answer.refusal.reason is Reason.BAD_IDENTIFIER
        assert "its sender is MOE-2 by its certificate" in answer.refusal.text
        assert [r.reason for r in bench.received.reports[reported:]] == [Reason.BAD_IDENTIFIER]


def test_without_certificates_a_source_is_as_stated(tmp_path: Path) -> None:
    aboard = Aboard(tmp_path)

    async def session(client: MrsClient) -> None:
        assert client.source == "MOE"
        assert (await client.authority.status()).caller is None
        await client.submit(client.command(SetTravelSpeed(0.5)))

    aboard.ground(session)
    aboard.close()


def test_the_command_line_takes_the_name_and_refuses_another(
    tmp_path: Path, ends: dict[str, Certificates]
) -> None:
    needed = AuthoritySettings(needed=True)
    aboard = Aboard(tmp_path, terms=TransportSettings(certificates=ends["rover"]), authority=needed)
    own = ("--to", aboard.uri, *options(ends["MOE-2"]))
    try:
        done = rover("command", *own, "--no-wait", "setTravelSpeed", "0.5")
        assert done.exit_code == 0, done.output
        assert done.output.startswith("MOE-2:")
        other = rover("command", *own, "--source", "MOE", "--no-wait", "setTravelSpeed", "0.5")
        assert other.exit_code == 1
        assert "source MOE: the certificate names MOE-2" in other.output
        stop = rover("command", *own, "--source", "MOE", "--no-wait", "stop")
        assert stop.exit_code == 1
        assert aboard.do(lambda bench: bench.executive.mode) is Mode.STOPPED
    finally:
        aboard.close()


def test_at_the_orbiter_no_client_uses_another_name_and_a_stop_is_uplinked(tmp_path: Path) -> None:
    async def session() -> None:
        async with orbiting(Sky(tmp_path, "jackal")) as (relay, _):
            (relayed,) = relay.rovers.values()
            forged = Command(Identity("MOE", 7), MoveForward(1.0), "direct", peer="MOE-2")
            with raises(1, 0):
                await relayed.submit(forged)
            assert relay.agent.health().queued == 0
            with raises(1, 0):
                await relayed.submit(replace(forged, request=Stop()))
            assert relay.agent.health().queued == 1
            assert relayed.record.ledger.digest_of(forged.identity) is None

    asyncio.run(session())


EVIL = "ok\x1b[2J\r\nMOE:1 EXECUTED\x00\u202e"


def test_texts_of_others_are_shown_as_they_are_and_do_nothing(
    capsys: pytest.CaptureFixture[str],
) -> None:
    echo_line(f"event {EVIL}", word="event", fg="red")
    print_table([(EVIL, "1")], "text", "number")
    print(describe_error(with_text(AreaError.REJECTED, EVIL)))
    print(describe_error(with_text(StandardError.INTERNAL, EVIL)))
    shown = capsys.readouterr().out
    assert not [c for c in shown if not c.isprintable() and c != "\n"]
    assert not [line for line in shown.splitlines() if line.strip().startswith("MOE:1")]
    assert "\\x1b[2J" in shown


def test_a_plan_of_another_forges_no_line_of_the_terminal() -> None:
    update = PlanUpdate(EVIL, PlanStatus.FAILED, 0.0, EVIL, done=0, total=1, text=EVIL)

    @click.command()
    def show() -> None:
        echo_line(PlanLines().line(update))

    shown = CliRunner().invoke(show).output
    assert shown.count("\n") == 1
    assert "\x1b" not in shown


def test_a_transfer_is_ended_by_its_client_or_the_authority_holder(
    secured: Aboard, ends: dict[str, Certificates]
) -> None:
    secured.put("film.avi", bytes(4_000_000))
    secured.runs = True

    async def session() -> None:
        tls = ends["MOE"].for_consumer()
        consumer = await Consumer.connect(mrs_specification(), secured.uri, tls=tls)
        async with (
            await connected(secured, ends["MOE"]) as again,
            await connected(secured, ends["MOE-2"]) as other,
        ):
            for ends_it in (again, other):
                wanted = ("FileTransfer", "retrieveFile", "film.avi", None, 256)
                async with consumer.progress(*wanted) as fetching:
                    await anext(fetching)
                    with pytest.raises(MalError, match="belongs to MOE: it or the"):
                        await other.cancel_transfer("film.avi")
                    if ends_it is other:
                        await other.authority.request()
                    await ends_it.cancel_transfer("film.avi")
                    with pytest.raises(MalError, match="was cancelled"):
                        await fetching.response()
        await consumer.close()

    asyncio.run(session())
    secured.runs = False
