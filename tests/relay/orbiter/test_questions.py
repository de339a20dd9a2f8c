"""Open questions of a relayed rover at the orbiter: notified once, returned to clients."""

import asyncio
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner

from adapters.cli.main import main
from adapters.mrs.cli.sending import CommandSender, RequestChoice
from adapters.mrs.spec import AreaError
from executive.commands import AnswerQuestion
from executive.values.plan_nodes import Question
from executive.values.reports import Severity
from tests.mrs.aboard import raises
from tests.relay.orbiter.sky import Sky, ground, landed, orbiting, until

DITCH = Question("plan:day/Sequence/ditch", "Cross?", ("cross", "back"), "back", 1796000000.0)
CAMP = Question("plan:night/Ask", "Sleep?", ("yes", "no"), None, None)


async def test_operators_see_and_answer_a_question_without_naming_its_plan(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sky = Sky(tmp_path, "jackal")
    async with orbiting(sky) as (relay, (station,)), landed(sky, "jackal") as far:
        (relayed,) = relay.rovers.values()

        async def rover(*typed: str) -> tuple[int, str]:
            arguments = ["plan", *typed, "--to", str(station.uri)]
            run = CliRunner(env={"COLUMNS": "80"}).invoke
            result = await asyncio.to_thread(run, main, arguments)
            return result.exit_code, result.output

        for typed in (("status",), ("answer", "ditch", "cross")):
            status, text = await rover(*typed)
            assert status == 1
            assert "an orbiter reports plans with an open question only" in text
        await far.question(100.0, day=DITCH)
        await until(lambda: relayed.questions.utc_s == 100.0)
        for named in ((), ("day",)):
            status, text = await rover("status", *named)
            assert status == 0
            assert "Cross? (cross or back, else back)" in text
        sent = []

        async def send(_: CommandSender, choose: RequestChoice, *_others: object) -> bool:
            client = await ground(station)
            sent.append(await choose(client))
            await client.close()
            return True

        monkeypatch.setattr(CommandSender, "_send", send)
        assert (await rover("answer", "ditch", "cross"))[0] == 0
        assert sent == [AnswerQuestion("day", "ditch", "cross")]


async def test_a_question_is_notified_once_and_so_is_its_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sky = Sky(tmp_path, "jackal")
    async with orbiting(sky) as (relay, (station,)), landed(sky, "jackal") as far:
        (relayed,) = relay.rovers.values()
        client = await ground(station)
        notified: list[tuple[Severity, str]] = []

        monkeypatch.setattr(relayed, "notify", lambda *each: notified.append(each))
        await far.question(100.0, day=DITCH)
        await far.question(130.0, day=DITCH)
        await far.question(140.0, day=replace(DITCH, until_utc_s=1796000060.0))  # asked again
        await far.question(160.0, day=replace(DITCH, until_utc_s=None), night=CAMP)
        await until(lambda: relayed.questions.utc_s == 160.0)
        texts = [text for _, text in notified]
        assert texts == [
            "question Sequence/ditch of plan day: Cross? (cross or back), until"
            " 2026-11-30 00:53:20 UTC, then back; answer by: answerQuestion day Sequence/ditch"
            " OPTION",
            "question Sequence/ditch of plan day: Cross? (cross or back), until"
            " 2026-11-30 00:54:20 UTC, then back; answer by: answerQuestion day Sequence/ditch"
            " OPTION",
            "question Ask of plan night: Sleep? (yes or no); answer by: answerQuestion night Ask"
            " OPTION",
        ]
        assert (await client.get_status()).activePlan == "day"
        (node,) = await client.get_plan_nodes("night")
        assert (node.path, node.kind, node.question) == (CAMP.key, "Ask", CAMP)
        await far.question(190.0, night=CAMP)
        await far.question(150.0, day=DITCH)  # overtaken
        await far.question(220.0)
        await until(lambda: relayed.questions.utc_s == 220.0)
        assert notified[3:] == [
            (Severity.INFORMATIONAL, "question Sequence/ditch of plan day is no longer open"),
            (Severity.INFORMATIONAL, "question Ask of plan night is no longer open"),
        ]
        with raises(AreaError.NOT_FOUND.value):
            await client.get_plan_nodes("night")
        await far.question(4e9, night=CAMP)  # by a clock that is corrected later
        await until(lambda: relayed.questions.utc_s == 4e9)
        await far.question(230.0)
        await until(lambda: relayed.questions.utc_s == 230.0)
        await client.close()
