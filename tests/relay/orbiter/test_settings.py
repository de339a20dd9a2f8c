"""The orbiter's settings: what does not fit is named, with the rover that it is of."""

from pathlib import Path

import pytest

from adapters.mal import MalError
from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import describe_error
from adapters.relay.orbiter import load_orbiter
from executive.commands import (
    ExecuteAction,
    Mode,
    MoveForward,
    Precondition,
    Request,
    Resume,
    TakePicture,
)
from executive.settings import SettingsError, config_folder
from tests.relay.orbiter.sky import Sky, ground, landed, orbiting

OURS = config_folder() / "mops" / "orbiter.yaml"
MOCUP = "ltp: {address: {host: 127.0.0.1, port: 1115}}"


@pytest.mark.parametrize(
    ("changed", "fault"),
    [
        (("asset: mocup", "asset: ''"), r"rovers\[1\]: asset is '': a name has"),
        (("asset: mocup", "asset: a|b"), r"rovers\[1\]: asset is 'a\|b': a name has"),
        (("asset: mocup", "asset: ../../evil"), "asset is '../../evil': it names files"),
        (("asset: mocup", "asset: JACKAL"), "have the same asset, jackal"),
        (("eid: ipn:3.1", "eid: two"), r"rovers\[1\]: eid: not an endpoint such as"),
        (("port: 21101", "port: -1"), r"rovers\[1\]: port: -1 is not in 0 to 65535"),
        (("lifetime_s: 86400.0", "lifetime_s: .inf"), "lifetime_s: expected a finite number"),
        (("link_timeout_s: 60.0", "link_timeout_s: .nan"), "link_timeout_s: expected a finite"),
        (("  ltp: {host: 127.0.0.1, port: 1113}", "  {}"), r"lacks ltp, which the link to rover 1"),
        ((MOCUP, "udp: {address: {host: 127.0.0.1, port: 1115}}"), r"lacks udp, .* 2 \(mocup\)"),
        ((MOCUP, "tcpcl: {address: null}"), r"tcpcl.address of rover 2 \(mocup\) is null, and"),
        ((MOCUP, ""), r"rover 2 \(mocup\) needs exactly one of ltp, tcpcl, udp: add one"),
        (
            (MOCUP, f"{MOCUP}\n    tcpcl: {{address: null}}"),
            r"rover 2 \(mocup\) needs exactly one of .*: it has ltp and tcpcl",
        ),
        (("port: 1115", "port: 0"), r"ltp.address of rover 2 \(mocup\) has port 0"),
        (("rovers:", "agent: ion\nrovers:"), r"agent is ion.*: remove ltp of rover 1 \(jackal\)"),
    ],
)
def test_settings_that_do_not_fit_are_refused(
    tmp_path: Path, changed: tuple[str, str], fault: str
) -> None:
    text = OURS.read_text()
    assert changed[0] in text
    path = tmp_path / "wrong.yaml"
    path.write_text(text.replace(*changed))
    with pytest.raises(SettingsError, match=fault) as caught:
        load_orbiter(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


async def refusal(client: MrsClient, request: Request) -> str:
    with pytest.raises(MalError) as caught:
        await client.submit(client.command(request))
    return describe_error(caught.value)


async def test_a_brick_is_offered_its_known_operations(tmp_path: Path) -> None:
    sky = Sky(tmp_path, "mocup", numbered=False)
    _, mocup = load_orbiter(config_folder() / "mops" / "orbiter.yaml").rovers
    sky.operations = mocup.operations
    async with (
        orbiting(sky) as (relay, (station,)),
        landed(sky, "mocup") as far,
        await ground(station) as client,
    ):
        far.ledger = ""
        offered = {each.name: each.operations for each in await client.get_services()}
        assert not {"Plan", "FileManagement"} & set(offered)
        assert offered["MotionControl"] == (1, 2, 3, 4, 5, 7, 9, 10, 12, 13)
        assert offered["Camera"] == (2, 3, 4, 5)
        assert offered["Action"] == (1,)
        for request in (TakePicture(), Resume()):
            assert "does not serve" in await refusal(client, request)
        text = await refusal(client, ExecuteAction("VIDEO ON"))
        assert text.startswith("NotSupported: the rover has no actions; the orbiter has")
        only = client.command(MoveForward(1.0), precondition=Precondition(mode=Mode.IDLE))
        with pytest.raises(MalError, match="does not support preconditions"):
            await client.submit(only)
        with pytest.raises(MalError, match="mocup supports no preconditions over the relay"):
            await next(iter(relay.rovers.values())).submit(only)
        assert (await client.run(client.command(ExecuteAction("contact up")))).executed
        assert (await client.run(client.command(MoveForward(1.0)))).executed
        assert [message.command for message in far.commands] == ["MOVE_FORWARD"]
        assert not relay.agent.health().queued
