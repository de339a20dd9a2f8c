"""Wrong messages against living providers: sound ones meet every goal, broken ones are told."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner

from adapters.mal import Encoding
from adapters.mrs.spec import mrs_specification
from executive.settings import load_settings
from tests.benchmarks.commands import bench
from tests.stress import broken_providers as broken
from tests.stress import mal_fuzz
from tests.support.examples import ALL

FEW, ENOUGH = 1200, 2500
"""Messages; more until so many connections are kept as may not be."""
SOME = 1000 if ALL else 600
HELD, FREE = (Encoding.FIXED, True), (Encoding.FIXED, False)


def missed(
    prepare: Callable[[], None], part: tuple[Encoding, bool], count: int
) -> dict[str, float]:
    settings = load_settings("jackal")
    figures = mal_fuzz.measure(settings, count, 1, lambda _: None, prepare, [part])
    return {
        figure.name.removeprefix("fuzz: "): figure.value
        for figure in figures
        if not figure.met and figure.goal
    }


@pytest.mark.parametrize(
    ("broken", "part", "names"),
    [
        (broken.dies, HELD, {"providers that died or hung"}),
        (broken.is_silent, HELD, {"left without an answer"}),
        (broken.hangs_up, HELD, {"hung up on without a reason"}),
        (broken.answers_twice, HELD, {"answers to nothing"}),
        (broken.is_lenient, HELD, {"taken though not sound"}),
        (broken.raises, HELD, {"answered by INTERNAL", "errors in the log"}),
        (broken.grows, HELD, {"memory gained"}),
        (broken.leaks_files, HELD, {"files gained"}),
        (broken.leaks_tasks, HELD, {"tasks gained"}),
        (broken.leaks_connections, HELD, {"connections kept"}),
        (broken.serves_no_client, HELD, {"good clients not served"}),
        (broken.rolls_away, HELD, {"motion that nobody commanded"}),
        (broken.moves_by_itself, FREE, {"motion that nobody commanded"}),
        (broken.accepts_commands_without_source, HELD, {"commands that nobody gave"}),
    ],
)
def test_a_broken_provider_is_found_out(
    broken: Callable[[], None],
    part: tuple[Encoding, bool],
    names: set[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("tests.stress.mal_attack.PATIENCE_S", 0.3)
    monkeypatch.setattr("tests.stress.mal_fuzz.SETTLE_S", 1.0)
    count = ENOUGH if "connections kept" in names else FEW
    assert missed(broken, part, count).keys() >= names


@pytest.mark.slow
def test_no_invalid_message_breaks_a_provider_in_any_encoding(tmp_path: Path) -> None:
    out = tmp_path / "figures.json"
    requested = ["fuzz", "--messages", str(len(mal_fuzz.PARTS) * SOME), "--seed", "2"]
    result = CliRunner().invoke(bench, [*requested, "--json", str(out)])
    assert result.exit_code == 0, result.output
    values = {row["name"]: row["value"] for row in json.loads(out.read_text())}
    areas = mrs_specification().areas
    operations = [
        each for area in areas for service in area.services for each in service.operations
    ]
    assert values["fuzz: operations with sound messages"] > 0.75 * len(operations)  # by chance
    assert values["fuzz: mutated messages"] >= len(mal_fuzz.PARTS) * SOME
