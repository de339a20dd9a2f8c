"""The metrics of `rover-mops`: the link to a rover, and what became of its commands."""

from pathlib import Path

import pytest

from adapters.mal import MalError
from adapters.metrics import ReportCounter
from executive.commands import ExecuteAction, MoveForward, Stop
from executive.values.reports import Identity, Report, ReportKind, Severity, Stage
from tests.relay.orbiter.sky import STAGES, catch_up, landed
from tests.relay.orbiter.test_process import Orbiter
from tests.support.metrics import check_documented, scrape, scrape_until
from tests.support.processes import running

REASONS = "rover_orbiter_command_reasons_total"
COMMANDS = "rover_orbiter_commands_total"


async def test_the_link_and_the_ends_of_commands_are_shown(tmp_path: Path) -> None:
    orbiter = Orbiter(tmp_path)
    with orbiter.serving("--metrics", "0") as process:
        url = process.output(r"metrics at (http://\S+)")
        before = scrape_until(url, lambda page: page.value("rover_orbiter_link_contact") == 1.0)
        assert before.value(COMMANDS) == 0.0
        assert before.value("rover_orbiter_last_received_age_seconds") is None, "never"
        async with landed(orbiter.sky, "jackal"), await orbiter.client() as client:
            first = client.command(MoveForward(1.0))
            await client.submit(first)
            await client.submit(client.command(Stop()))
            await catch_up(client, 2 * len(STAGES))
            with pytest.raises(MalError):
                await client.submit(first)
            assert (await client.run(client.command(ExecuteAction("CONTACT PLAN")))).executed
            page = scrape_until(url, lambda page: (page.value(COMMANDS) or 0.0) >= 3.0)
        page.check_names()
        check_documented(page, "orbiter")
        assert page.value(COMMANDS, asset="jackal", command="moveForward", state="EXECUTED") == 1.0
        assert page.value(COMMANDS, asset="jackal", command="stop", state="EXECUTED") == 1.0
        assert page.value(COMMANDS, command="executeAction", state="EXECUTED") == 1.0, (
            "the orbiter's own"
        )
        assert page.value(COMMANDS) == 3.0, "a retransmitted command is no further one"
        assert page.value(REASONS) == 0.0
        assert page.value("rover_orbiter_bundles_sent_total") >= 2.0  # type: ignore[operator]
        assert page.value("rover_orbiter_store_bytes", store="bundles") > 1000.0  # type: ignore[operator]
        assert page.value("rover_orbiter_store_bytes", store="jackal") > 1000.0  # type: ignore[operator]
        taken = ("--config", str(orbiter.settings), "--data", str(tmp_path / "other"))
        port = url.rpartition(":")[2].partition("/")[0]
        text = orbiter.settings.read_text()
        for used in (orbiter.sky.orbiter_port, orbiter.port):
            text = text.replace(f"port: {used}", "port: 0")
        orbiter.settings.write_text(text)
        with running(tmp_path / "log", "rover-mops", *taken, "--metrics", port) as second:
            assert second.ended() == 1
            assert f"Error: metrics cannot be served at 127.0.0.1:{port} (Add" in second.text
        assert process.end() == 0
    with orbiter.serving("--metrics", "0") as process:
        assert scrape(process.output(r"metrics at (http://\S+)")).value(COMMANDS) == 0.0


def test_a_late_report_of_a_lost_command_ends_it_once() -> None:
    counter, sent = ReportCounter(), Identity("anna", 1)
    counter.begin(sent, "moveForward")
    alarm = (ReportKind.LINK, Severity.ALARM, "lost", sent)
    counter.note(Report(1, 0.0, *alarm), 1, is_lost=True)
    assert (counter.lost, sum(counter.commands.values())) == (1, 0)
    late = (ReportKind.COMMAND, Severity.INFORMATIONAL, "", sent, Stage.EXECUTED)
    for _ in range(2):
        counter.note(Report(2, 0.0, *late), 2)
    assert counter.commands["moveForward", "EXECUTED"] == sum(counter.commands.values()) == 1
