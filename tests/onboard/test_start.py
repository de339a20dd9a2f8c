"""What the executive starts with: the class of its rover, the terms of its link, a launch file."""

import ast
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from adapters.mal import Encoding
from adapters.mrs.ground import MrsClient
from adapters.mrs.transport import TransportSettings
from adapters.onboard.process import main
from adapters.onboard.service import rover_kind
from adapters.ros import NavigatedRosRover, RosRover
from executive.commands.catalogue import SetTravelSpeed
from executive.settings import (
    NavigationGate,
    NavigationSettings,
    Settings,
    SettingsError,
    load_settings,
)
from executive.values.reasons import Reason
from tests.support.certificates import Ends, make_ends, options
from tests.support.ground import call_ground, carry_out
from tests.support.processes import executive, running

JACKAL = load_settings("jackal")
MOCUP = load_settings("mocup")
NAVIGATED = replace(JACKAL, navigation=NavigationSettings(NavigationGate.RELAY))


def test_a_rover_on_cmd_vel_needs_no_name() -> None:
    assert rover_kind(JACKAL) is RosRover
    assert rover_kind(replace(JACKAL, rover="adapters.ros.rover:RosRover")) is RosRover
    assert rover_kind(NAVIGATED) is NavigatedRosRover


def test_mocup_is_named_by_its_settings() -> None:
    assert rover_kind(MOCUP).__qualname__ == "MocupOnRos"


@pytest.mark.parametrize(
    ("asset", "rover", "reported"),
    [
        (MOCUP, None, "needs the key rover: module:Class"),
        *((MOCUP, name, "module:Class, such as") for name in ("mocup", "mocup:", ":Mocup", "")),
        (JACKAL, "scuot.rover:Scout", "No module named 'scuot'.*PYTHONPATH"),
        (MOCUP, "adapters.onboard.mocup:Mocup", "has no class 'Mocup'; there are: MocupOnRos$"),
        (JACKAL, "adapters.ros.rover:STANDING", "has no class 'STANDING'; there are: RosRover$"),
        (JACKAL, MOCUP.rover, "lacks drive: with locomotion velocity"),
        (NAVIGATED, "adapters.ros:RosRover", "lacks .*navigate, open_gate, plan_path: with .*"),
        (MOCUP, "adapters.ros.rover:RosRover", "lacks execute_motion, halt: with .* delegated"),
    ],
)
def test_an_unsuitable_class_is_reported_with_the_reason(
    asset: Settings, rover: str | None, reported: str
) -> None:
    with pytest.raises(SettingsError, match=re.compile(reported, re.DOTALL)):
        rover_kind(replace(asset, rover=rover))


@pytest.mark.ros
def test_the_process_does_not_start_without_its_rover(ros_domain: int, tmp_path: Path) -> None:
    assert ros_domain
    settings = tmp_path / "crab.yaml"
    text = (Path(__file__).parents[2] / "config" / "jackal.yaml").read_text()
    settings.write_text(text + "rover: crab:Crab\n")
    options = ("--asset", str(settings), "--data", str(tmp_path / "data"), "--port", "0")
    with running(tmp_path / "log", "rover-executive", *options) as process:
        assert process.ended() == 2
        assert "rover crab:Crab: No module named 'crab'" in process.text
        assert "Traceback" not in process.text


LAUNCH_FILE = Path(__file__).parents[2] / "launch" / "rover.launch.py"


def test_arguments_are_options_of_the_process_with_its_defaults() -> None:
    module = ast.parse(LAUNCH_FILE.read_text())
    (options,) = (
        ast.literal_eval(node.value)
        for node in module.body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "OPTIONS"
    )
    texts = [word for name, (text, _) in options.items() if text for word in (f"--{name}", text)]
    files = ("certificate", "key", "authorities")
    assert {name for name, (text, _) in options.items() if not text} == set(files)
    assert parsed(texts) == parsed([])
    taken = parsed([word for name in files for word in (f"--{name}", "a.pem")])
    assert [str(taken[name]) for name in files] == ["a.pem"] * 3


def parsed(texts: list[str]) -> dict[str, Any]:
    params: dict[str, Any] = main.make_context("rover-executive", texts).params
    return params


CANNOT_START, USAGE = 1, 2


@pytest.fixture(scope="module")
def ends(module_ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Ends:
    assert module_ros_domain
    return make_ends(tmp_path_factory.mktemp("certificates"))


@pytest.mark.ros
def test_commands_go_over_tls_and_in_another_encoding(tmp_path: Path, ends: Ends) -> None:
    reported = (*options(ends.rover), "--encoding", "split", "--host", "0.0.0.0")
    with executive(tmp_path, *reported) as (_, uri):
        reached = uri.replace("0.0.0.0", "127.0.0.1")
        terms = TransportSettings(Encoding.SPLIT, ends.ground)

        async def command(client: MrsClient) -> None:
            unauthorized = await client.run(client.command(SetTravelSpeed(0.4)))
            assert unauthorized.reports[-1].reason is Reason.NO_AUTHORITY
            await client.authority.request()
            assert (await client.run(client.command(SetTravelSpeed(0.5)))).executed

        call_ground(reached, command, terms)
        assert call_ground(reached, lambda client: client.get_speeds(), terms).travelSpeed == 0.5
        for wrong, why in (
            (TransportSettings(Encoding.SPLIT, ends.stranger), "does not trust this certificate"),
            (TransportSettings(Encoding.SPLIT), "is TLS needed"),
        ):
            with pytest.raises(ConnectionError, match=why):
                carry_out(reached, SetTravelSpeed(0.5), terms=wrong)


@pytest.mark.ros
@pytest.mark.usefixtures("module_ros_domain")
@pytest.mark.parametrize(
    ("typed", "status", "why"),
    [
        (["--host", "0.0.0.0"], CANNOT_START, "give --certificate.*or add --clear-text"),
        (["--certificate", "rover.pem"], USAGE, "TLS needs all three"),
        (["--encoding", "xml"], USAGE, "'xml' is not one of"),
        (
            ["--certificate", "gone.pem", "--key", "gone.key", "--authorities", "gone.ca"],
            CANNOT_START,
            "Error: TLS: gone.pem: No such file or directory; .*PEM files that this process can",
        ),
    ],
)
def test_terms_that_make_no_sense(tmp_path: Path, typed: list[str], status: int, why: str) -> None:
    reported = ("--port", "0", "--data", str(tmp_path / "data"), *typed)
    with running(tmp_path / "log", "rover-executive", *reported) as process:
        assert process.ended() == status
        assert re.search(why, process.text)
        assert "Traceback" not in process.text
