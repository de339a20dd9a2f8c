"""What both ends agree on beforehand: the encoding of bodies, and TLS with certificates."""

import asyncio
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import pytest

from adapters.mal import CertificateError, Certificates, Encoding
from adapters.mrs.ground import MrsClient
from adapters.mrs.link import MrsLink
from adapters.mrs.spec import Stage
from adapters.mrs.transport import CLEAR, TransportSettings
from executive.commands import MoveForward
from tests.mrs.aboard import Aboard, LinkedBench, rover
from tests.support.certificates import Ends, make_ends, options

DONE, USAGE, UNREACHABLE = 0, 2, 3
STAGES = [Stage.RECEIVED, Stage.ACCEPTED, Stage.STARTED, Stage.EXECUTED]


@pytest.fixture(scope="module")
def ends(tmp_path_factory: pytest.TempPathFactory) -> Ends:
    return make_ends(tmp_path_factory.mktemp("certificates"))


@contextmanager
def started(folder: Path, terms: TransportSettings) -> Iterator[Aboard]:
    rover = Aboard(folder, terms=terms)
    yield rover
    rover.close()


@pytest.fixture
def secured(tmp_path: Path, ends: Ends) -> Iterator[Aboard]:
    """Give a rover that asks for certificates."""
    with started(tmp_path, TransportSettings(certificates=ends.rover)) as rover:
        yield rover


def connect(rover: Aboard, terms: TransportSettings) -> None:
    async def session() -> None:
        async with await MrsClient.connect(rover.uri, terms=terms, timeout_s=5.0):
            pass

    asyncio.run(session())


def carry_out(rover: Aboard, terms: TransportSettings) -> None:
    """Drive, and hear of it by answers, reports and telemetry."""
    rover.runs = True

    async def session() -> None:
        async with await MrsClient.connect(rover.uri, terms=terms) as client:
            values = await client.telemetry()
            outcome = await client.run(client.command(MoveForward(0.5)))
            assert [report.stage for report in outcome.reports] == STAGES
            assert (await client.get_pose()).x == pytest.approx(0.5, abs=0.05)
            assert (await anext(values)).value is not None

    asyncio.run(session())


@pytest.mark.parametrize("encoding", list(Encoding))
def test_a_rover_is_commanded_in_the_encoding_agreed_on(tmp_path: Path, encoding: Encoding) -> None:
    with started(tmp_path, TransportSettings(encoding)) as rover:
        carry_out(rover, TransportSettings(encoding))


def test_another_encoding_is_noticed(tmp_path: Path) -> None:
    with (
        started(tmp_path, TransportSettings(Encoding.SPLIT)) as rover,
        pytest.raises(ConnectionError, match="does it use another encoding than fixed"),
    ):
        connect(rover, CLEAR)


@pytest.mark.parametrize("encoding", [Encoding.FIXED, Encoding.SPLIT])
def test_a_rover_is_commanded_over_tls(tmp_path: Path, ends: Ends, encoding: Encoding) -> None:
    with started(tmp_path, TransportSettings(encoding, ends.rover)) as rover:
        carry_out(rover, TransportSettings(encoding, ends.ground))


def test_a_session_over_tls_outlives_the_link(secured: Aboard, ends: Ends) -> None:
    async def session() -> None:
        terms = TransportSettings(certificates=ends.ground)
        async with await MrsClient.connect(secured.uri, terms=terms) as client:
            secured.hang_up()
            secured.listen()
            assert (await client.get_asset()).asset == "jackal"

    asyncio.run(session())


@pytest.mark.parametrize(
    ("source", "why"),
    [
        (lambda ends: ends.stranger, "closed the connection: it does not trust this certificate"),
        (lambda ends: ends.suspicious, "is not trusted: .SSL.*certificate verify failed"),
        (lambda _: None, "closed the connection: is TLS needed"),
    ],
)
def test_an_untrusted_peer_is_notified(
    secured: Aboard, ends: Ends, source: Callable[[Ends], Certificates | None], why: str
) -> None:
    with pytest.raises(ConnectionError, match=why):
        connect(secured, TransportSettings(certificates=source(ends)))
    connect(secured, TransportSettings(certificates=ends.ground))


def test_a_rover_without_tls_does_not_answer_by_it(aboard: Aboard, ends: Ends) -> None:
    with pytest.raises(ConnectionError, match="perhaps it uses clear text"):
        connect(aboard, TransportSettings(certificates=ends.ground))
    aboard.hang_up()
    with pytest.raises(ConnectionError, match=f"no answer at {aboard.uri}$"):
        connect(aboard, TransportSettings(certificates=ends.ground))


def test_others_are_served_by_tls_or_when_clear_text_is_requested(
    aboard: Aboard, ends: Ends
) -> None:
    def listen(terms: TransportSettings, clear_text: bool = False) -> Callable[[LinkedBench], None]:
        def act(bench: LinkedBench) -> None:
            link = MrsLink(bench.settings, "0.0.0.0", 0, clear_text, terms)
            link.start(bench.executive)
            link.close()

        return act

    with pytest.raises(ValueError, match="give TLS certificates, or allow clear text"):
        aboard.do(listen(CLEAR))
    aboard.do(listen(TransportSettings(certificates=ends.rover)))
    aboard.do(listen(CLEAR, clear_text=True))


def test_certificates_that_cannot_be_used_are_named(aboard: Aboard, ends: Ends) -> None:
    closed = Certificates(ends.rover.certificate, Path("gone.key"), ends.rover.authorities)
    mixed = Certificates(ends.rover.certificate, ends.ground.key, ends.rover.authorities)
    for wrong, why in ((closed, "gone.key: No such file"), (mixed, "ground.key.*MISMATCH")):
        with pytest.raises(CertificateError, match=why):
            aboard.do(partial(started_with, wrong))
        with pytest.raises(CertificateError, match=why):
            connect(aboard, TransportSettings(certificates=wrong))


def started_with(certificates: Certificates, bench: LinkedBench) -> None:
    MrsLink(bench.settings, port=0, terms=TransportSettings(certificates=certificates)).start(
        bench.executive
    )


@pytest.mark.parametrize("typed", [["status"], ["command", "stop"]])
def test_certificates_are_options_of_what_people_type(
    secured: Aboard, ends: Ends, typed: list[str]
) -> None:
    secured.runs = True
    first, *rest = typed
    reported = rover(first, "--to", secured.uri, *options(ends.ground), *rest)
    assert reported.exit_code == DONE, reported.output
    unknown = rover(first, "--to", secured.uri, *options(ends.stranger), *rest)
    assert unknown.exit_code == UNREACHABLE
    assert "does not trust this certificate; check --cert" in unknown.output


def test_certificates_may_be_set_in_the_environment(
    secured: Aboard, ends: Ends, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROVER_URI", secured.uri)
    monkeypatch.setenv("ROVER_CERTIFICATE", str(ends.ground.certificate))
    monkeypatch.setenv("ROVER_KEY", str(ends.ground.key))
    assert "TLS needs all three" in rover("status").output
    monkeypatch.setenv("ROVER_AUTHORITIES", str(ends.ground.authorities))
    assert rover("status").exit_code == DONE


def test_the_encoding_is_an_option_too(tmp_path: Path) -> None:
    with started(tmp_path, TransportSettings(Encoding.SPLIT)) as split:
        assert rover("status", "--to", split.uri, "--encoding", "split").exit_code == DONE
        wrong = rover("status", "--to", split.uri)
    assert wrong.exit_code == UNREACHABLE
    assert "does it use another encoding than fixed?" in wrong.output


def test_certificates_that_make_no_sense_are_a_usage_error(secured: Aboard, ends: Ends) -> None:
    mixed = Certificates(ends.ground.certificate, ends.rover.key, ends.ground.authorities)
    for wrong, why in (
        (options(ends.ground)[:2], "TLS needs all three"),
        (["--key", "gone.key"], "does not exist"),
        (options(mixed), "MISMATCH"),
    ):
        result = rover("status", "--to", secured.uri, *wrong)
        assert result.exit_code == USAGE
        assert why in result.output
