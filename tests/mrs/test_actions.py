"""Text commands: which there are, and what they switch."""

import json

import pytest
from click.testing import CliRunner

from adapters.cli.main import main
from adapters.mrs.ground.client import MrsClient
from adapters.mrs.spec.errors import AreaError
from executive.commands.catalogue import ExecuteAction
from executive.runner import Executive
from tests.mrs.aboard import Aboard


async def test_text_commands_switch_the_video(aboard: Aboard, client: MrsClient) -> None:
    aboard.runs = True

    actions = {action.name: action.value for action in await client.list_actions()}
    assert list(actions) == ["VIDEO ON", "VIDEO OFF"]
    seen = []
    for name in actions:
        assert (await client.run(client.command(ExecuteAction(name)))).executed
        seen.append((await client.get_camera_state()).videoOn)
    assert seen == [True, False]
    refused = await client.run(client.command(ExecuteAction("VIDEO UP")))
    assert refused.refusal is not None
    assert refused.refusal.number == AreaError.NOT_SUPPORTED.value
    assert "there are: VIDEO ON, VIDEO OFF" in refused.refusal.extra.value


def test_an_asset_without_video_offers_none(aboard: Aboard) -> None:
    async def session(client: MrsClient) -> None:
        assert await client.list_actions() == ()
        assert not (await client.get_camera_state()).videoOn

    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.setattr(Executive, "video", None)
        aboard.ground(session)


def test_lists_them_at_the_terminal(aboard: Aboard) -> None:
    result = CliRunner().invoke(main, ["command", "--to", aboard.uri, "action"])
    assert result.exit_code == 0
    assert [line.split("  ")[0] for line in result.output.splitlines()] == ["VIDEO ON", "VIDEO OFF"]


def test_status_shows_whether_video_is_on(aboard: Aboard) -> None:
    def status(*options: str) -> str:
        result = CliRunner().invoke(main, ["status", "--to", aboard.uri, *options])
        assert result.exit_code == 0
        return result.output

    assert "video off" in status()
    aboard.carry_out(ExecuteAction("VIDEO ON"))
    assert "video on" in status()
    assert json.loads(status("--json"))["videoOn"] is True
