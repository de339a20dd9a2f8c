"""TLS between provider and consumer, mutual, with certificates made for the occasion."""

import ssl
from pathlib import Path
from typing import Any

import pytest
import trustme

from adapters.mal import (
    CallContext,
    Certificates,
    Consumer,
    MalError,
    Provider,
    StandardError,
    Subscription,
    address_to_listen,
    is_loopback,
)
from tests.mal.test_pubsub import Updates, publish
from tests.mal.test_transfer import COUNT, Source
from tests.mal.test_transfer import SPECIFICATION as TRANSFER
from tests.mal.wiretest import SERVICE, SPECIFICATION, connected, provided

WHY = "No such file|MISMATCH|PEM"


def certified(
    folder: Path,
    name: str,
    by: trustme.CA,
    believes: trustme.CA,
    address: str = "127.0.0.1",
    **identity: Any,
) -> Certificates:
    """Certify an address by one authority, for an end that believes another."""
    certificate, key, authorities = (folder / f"{name}.{part}" for part in ("pem", "key", "ca"))
    made = by.issue_cert(address, **identity)
    made.cert_chain_pems[0].write_to_path(str(certificate))
    made.private_key_pem.write_to_path(str(key))
    believes.cert_pem.write_to_path(str(authorities))
    return Certificates(certificate, key, authorities)


@pytest.fixture(scope="module")
def ends(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Certificates]:
    folder = tmp_path_factory.mktemp("certificates")
    ours, theirs = trustme.CA(), trustme.CA()
    return {
        "rover": certified(folder, "rover", ours, ours),
        "MOE": certified(folder, "MOE", ours, ours),
        "stranger": certified(folder, "stranger", theirs, ours),
        "suspicious": certified(folder, "suspicious", ours, theirs),
        "elsewhere": certified(folder, "elsewhere", ours, ours, "192.0.2.1"),
    }


def echo(_: object, value: Any, other: Any) -> tuple[Any, Any]:
    return value, other


async def test_interactions_and_updates_go_over_tls(ends: dict[str, Certificates]) -> None:
    async with (
        provided(tls=ends["rover"].for_provider()) as provider,
        connected(provider, tls=ends["MOE"].for_consumer()) as consumer,
    ):
        provider.serve(SERVICE, "echoLong", echo)
        publisher = provider.publisher(SERVICE, "monitor")
        assert await consumer.request(SERVICE, "echoLong", 1, None) == (1, None)
        updates = Updates()
        await consumer.subscribe(SERVICE, "monitor", Subscription(subscriptionId="s"), updates)
        publish(publisher, 1.0)
        assert await updates.have(1) == [1.0]


@pytest.mark.parametrize(
    ("identity", "name"),
    [
        ({"common_name": "MOE"}, "MOE"),
        ({}, "moe.example"),
        ({"common_name": "MOE\x1b[2J"}, ""),
    ],
)
async def test_a_handler_receives_the_name_of_the_certificate(
    identity: dict[str, str], name: str, tmp_path: Path
) -> None:
    authority, names = trustme.CA(), []
    moe = certified(tmp_path, "moe", authority, authority, "moe.example", **identity)
    assert (moe.name() or "") == name
    rover = certified(tmp_path, "rover", authority, authority)

    def submit(call: CallContext, *_: Any) -> None:
        names.append(call.peer_name)

    for tls in ((rover.for_provider(), moe.for_consumer()), (None, None)):
        async with provided(tls=tls[0]) as provider, connected(provider, tls=tls[1]) as consumer:
            provider.serve(SERVICE, "doSubmit", submit)
            await consumer.submit(SERVICE, "doSubmit", "lamp", True)
    assert names == [name, None]


async def test_a_large_transfer_over_tls_does_not_pile_up(ends: dict[str, Certificates]) -> None:
    source = Source()
    provider = Provider(TRANSFER, "Transfer")
    provider.serve("Transfer", "fetch", source.fetch)
    await provider.start(tls=ends["rover"].for_provider())
    tls = ends["MOE"].for_consumer()
    consumer = await Consumer.connect(TRANSFER, provider.uri, tls=tls)
    async with consumer.progress("Transfer", "fetch", COUNT) as progress:
        assert len([chunk async for chunk in progress]) == COUNT
    assert source.waiting < 1 << 20
    await consumer.close()
    await provider.close()


@pytest.mark.parametrize(
    ("provider_end", "consumer_end"),
    [("elsewhere", "MOE"), ("stranger", "MOE"), ("rover", "suspicious")],
)
async def test_a_consumer_refuses_a_provider_it_cannot_believe(
    provider_end: str, consumer_end: str, ends: dict[str, Certificates]
) -> None:
    async with provided(tls=ends[provider_end].for_provider()) as provider:
        with pytest.raises(MalError) as raised:
            async with connected(provider, tls=ends[consumer_end].for_consumer()):
                pass
        assert raised.value.number == StandardError.AUTHENTICATION_FAILED.value
        assert not provider._connections._open


async def test_a_provider_refuses_a_peer_without_a_trusted_certificate(
    ends: dict[str, Certificates],
) -> None:
    served: list[Any] = []
    async with provided(tls=ends["rover"].for_provider()) as provider:
        provider.serve(SERVICE, "echoLong", echo)
        provider.serve(SERVICE, "doSubmit", lambda *parts: served.append(parts))
        nameless = ssl.create_default_context(cafile=str(ends["MOE"].authorities))
        for tls in (ends["stranger"].for_consumer(), nameless, None):
            with pytest.raises(MalError) as raised:
                async with connected(provider, tls=tls, timeout_s=1.0) as refused:
                    await refused.submit(SERVICE, "doSubmit", "lamp", True)
            assert raised.value.number in (
                StandardError.DELIVERY_TIMEDOUT.value,
                StandardError.DESTINATION_LOST.value,
                StandardError.DESTINATION_TRANSIENT.value,
            )
        async with connected(provider, tls=ends["MOE"].for_consumer()) as good:
            assert await good.request(SERVICE, "echoLong", 1, 2) == (1, 2)
    assert served == []


async def test_tls_is_not_used_with_a_clear_text_peer(ends: dict[str, Certificates]) -> None:
    async with provided() as provider:
        with pytest.raises(MalError) as raised:
            async with connected(provider, tls=ends["MOE"].for_consumer()):
                pass
        assert raised.value.number in (
            StandardError.DESTINATION_TRANSIENT.value,
            StandardError.AUTHENTICATION_FAILED.value,
        )


@pytest.mark.parametrize("host", ["0.0.0.0", "", "::", "192.0.2.1"])
async def test_clear_text_for_others_must_be_requested(host: str) -> None:
    provider = Provider(SPECIFICATION, SERVICE)
    with pytest.raises(ValueError, match="give TLS certificates, or allow clear text"):
        await provider.start(host)


@pytest.mark.parametrize("host", ["rover.example", "[no]", "a" * 70])
async def test_an_unknown_host_is_reported_as_such(host: str) -> None:
    with pytest.raises(OSError, match="Name or service not known"):
        await Provider(SPECIFICATION, SERVICE).start(host)


def test_only_this_computer_reaches_loopback_however_it_is_written() -> None:
    hosts = ("localhost", "127.0.0.1", "127.1.2.3", "::1", "[::1]")
    assert all(map(is_loopback, hosts))
    assert not any(map(is_loopback, ("", "0.0.0.0", "[::]", "rover.local")))
    assert address_to_listen("[::1]") == "::1"


async def test_ipv6_in_brackets_is_listened_at() -> None:
    serves = Provider(SPECIFICATION, SERVICE)
    try:
        await serves.start("[::1]")
    except OSError:
        pytest.skip("no IPv6 here")
    assert str(serves.uri).startswith("maltcp://[::1]:")
    await serves.close()


async def test_clear_text_for_others_can_be_requested(ends: dict[str, Certificates]) -> None:
    for options in ({"clear_text": True}, {"tls": ends["rover"].for_provider()}):
        provider = Provider(SPECIFICATION, SERVICE)
        await provider.start("0.0.0.0", **options)
        await provider.close()
    provider = Provider(SPECIFICATION, SERVICE)
    await provider.start("localhost")
    await provider.close()


def test_files_that_do_not_fit_are_refused(ends: dict[str, Certificates], tmp_path: Path) -> None:
    rover, other = ends["rover"], ends["MOE"]
    for wrong in (
        Certificates(rover.certificate, other.key, rover.authorities),
        Certificates(rover.certificate, tmp_path / "none", rover.authorities),
        Certificates(rover.certificate, rover.key, tmp_path / "none"),
        Certificates(rover.key, rover.key, rover.authorities),
    ):
        for make in (wrong.for_provider, wrong.for_consumer):
            with pytest.raises(OSError, match=WHY):
                make()
