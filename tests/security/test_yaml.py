"""YAML that is small on the disk and endless to walk: one error at once, from every reader."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner

from adapters.mops import load_dictionary
from adapters.relay.orbiter.settings import load_orbiter
from adapters.relay.rover.settings import load_relay
from executive.settings import SettingsError, load_settings, parse_yaml, with_values
from executive.settings.settings_files import MAX_YAML_DEPTH, MAX_YAML_NODES
from sim.campaign.reading import load_campaign
from sim.rover.world import load_world
from sim.scenario.commands import scenario

PRODUCT = Path(__file__).parents[2]


def aliases(depth: int, wide: int = 9) -> str:
    """Return lists of aliases of lists of aliases: wide to the power of depth texts."""
    lines = [f"a0: &a0 [{', '.join(['x'] * wide)}]"]
    for level in range(1, depth):
        lines.append(f"a{level}: &a{level} [{', '.join([f'*a{level - 1}'] * wide)}]")
    return "\n".join(lines)


MERGES = "\n".join(
    ["a0: &a0 {x: 1}"]
    + [f"a{n}: &a{n} {{<<: [{', '.join([f'*a{n - 1}'] * 9)}]}}" for n in range(1, 29)]
)
HOSTILE = {
    "nine aliases to the power of 29": (aliases(29), "nodes, its aliases expanded"),
    "merged keys": (MERGES, "nodes, its aliases expanded"),
    "aliases as keys": (f"{aliases(28)}\n? *a27\n: 1", "nodes, its aliases expanded"),
    "many nodes": ("- x\n" * (MAX_YAML_NODES + 1), "nodes, its aliases expanded"),
    "20,000 lists": ("[" * 20_000 + "]" * 20_000, "is nested too deeply"),
    "20,000 lists, one a line": ("- " * 20_000 + "1", "is nested too deeply"),
    "20,000 maps": ("{a: " * 20_000 + "}" * 20_000, "is nested too deeply"),
    "20,000 keys": ("? " * 20_000 + "1", "is nested too deeply"),
    "a list of itself": ("a: &a [*a]", "is not YAML"),
}
READERS: dict[str, Callable[[Path], object]] = {
    "asset": lambda path: load_settings(str(path)),
    "world": load_world,
    "campaign": lambda path: load_campaign(str(path)),
    "orbiter": load_orbiter,
    "relay": lambda path: load_relay("jackal", path),
    "dictionary": load_dictionary,
    "calibration": lambda path: with_values(path.read_text(), {"mpc.delay_s": 1.0}),
}


@pytest.mark.parametrize(("text", "message"), HOSTILE.values(), ids=HOSTILE)
def test_a_text_too_deep_to_read_is_one_error(text: str, message: str) -> None:
    with pytest.raises(SettingsError, match=message) as caught:
        parse_yaml(text, "theirs.yaml")
    assert str(caught.value).startswith("theirs.yaml: ")


@pytest.mark.parametrize("read", READERS.values(), ids=READERS)
def test_no_reader_expands_it(read: Callable[[Path], object], tmp_path: Path) -> None:
    path = tmp_path / "theirs.yaml"
    path.write_text(aliases(29))
    with pytest.raises(SettingsError, match="its aliases expanded"):
        read(path)


def test_a_scenario_of_it_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "theirs.yaml"
    path.write_text(aliases(29))
    result = CliRunner().invoke(scenario, [str(path)], catch_exceptions=False)
    assert (result.exit_code, len(result.output.splitlines())) == (2, 1)


def test_aliases_that_are_few_are_data() -> None:
    assert parse_yaml("a: &a {x: 1}\nb: [*a, *a]\nc: {<<: *a, y: 2}", "ours.yaml") == {
        "a": {"x": 1},
        "b": [{"x": 1}] * 2,
        "c": {"x": 1, "y": 2},
    }
    nested = MAX_YAML_DEPTH - 1
    assert parse_yaml("[" * nested + "]" * nested, "ours.yaml")


def test_nothing_else_in_the_product_loads_yaml() -> None:
    """A reader of its own would have no bounds; the editor parses with these first."""
    loads = re.compile(r"\byaml\.(?!safe_dump\b|\w*(?:Node|Event|Error|Loader)\b)(\w+)\(")
    found = {
        (path.relative_to(PRODUCT).as_posix(), name)
        for package in ("executive", "trees", "adapters", "sim")
        for path in (PRODUCT / package).rglob("*.py")
        for name in loads.findall(path.read_text(encoding="utf-8"))
    }
    assert found == {
        ("executive/settings/settings_files.py", "load"),
        ("executive/settings/settings_files.py", "parse"),
        ("executive/settings/file_edit.py", "compose"),
    }
