"""Mutants are made of rules alone, and one that a recording exercises is noticed by its replay."""

import ast
from collections import Counter
from contextlib import closing
from pathlib import Path

import pytest

from adapters.recording import RunFile
from executive.commands import MoveForward
from tests.benchmarks import mutants
from tests.benchmarks.mutation import Mutant, MutantKind, probes, sample
from tests.benchmarks.mutation import mutants as mutants_of
from tests.suite import CHECKOUT
from tests.support.kinematic import Bench

RULES = '''\
"""Rules."""
@dataclass(frozen=True)
class Held:
    held: bool

LONGEST_S: Final = 5.0

def judge(self, asked: Literal[3], text: str = "5 < 6") -> bool:
    """Whether 7 > 8."""
    match asked:
        case Drive(way_m) if way_m > 2:
            self.stop()
        case Turn():
            _LOG.info("a turn")
        case Hold():
            return zip(strict=True)
        case _:
            assert_never(asked)
    if not self.held and (
        self.age_s <= LONGEST_S
    ):
        return True
    raise ValueError(f"{asked} is not {self.age_s > 9}")
'''
CHANGED = {
    "- LONGEST_S: Final = 5.0|+ LONGEST_S: Final = 6.0",
    "- case Drive(way_m) if way_m > 2:|+ case Drive(way_m) if way_m <= 2:",
    "- case Drive(way_m) if way_m > 2:|+ case Drive(way_m) if way_m >= 2:",
    "- case Drive(way_m) if way_m > 2:|+ case Drive(way_m) if way_m > 3:",
    "- case Drive(way_m) if way_m > 2:|+ case Drive(way_m) if False:",
    "- self.stop()|+ pass",
    "- case Hold():|+ case Hold() if False:",
    "- if not self.held and (|+ if bool(self.held) and (",
    "- self.age_s <= LONGEST_S|+ self.age_s > LONGEST_S",
    "- self.age_s <= LONGEST_S|+ self.age_s < LONGEST_S",
    "- if not self.held and (|- self.age_s <= LONGEST_S|- ):"
    "|+ if (not self.held or self.age_s <= LONGEST_S):",
    "- if not self.held and (|- self.age_s <= LONGEST_S|- ):|+ if False:",
    "- return True|+ return False",
}


def test_rules_are_changed_one_at_a_time_and_texts_are_not(tmp_path: Path) -> None:
    path = tmp_path / "executive" / "rules.py"
    path.parent.mkdir()
    path.write_text(RULES)
    without = path.parent / "settings" / "asset_settings.py"
    without.parent.mkdir()
    without.write_text(RULES)
    found = list(mutants_of(tmp_path))
    assert {"|".join(each.diff(path.read_bytes())) for each in found} == CHANGED
    assert len(found) == len(CHANGED)
    for each in found:
        ast.parse(each.applied(path.read_bytes()))
    heads = {each.text: (each.first, each.last, each.within) for each in found}
    assert heads["6.0"] == (6, 6, False)
    assert heads["self.age_s > LONGEST_S"] == (19, 21, True)
    assert heads[" if False"] == (16, 16, True), "what would be done no more"


def test_where_a_bound_itself_is_met_is_probed_in_place(tmp_path: Path) -> None:
    path = tmp_path / "executive" / "rules.py"
    path.parent.mkdir()
    path.write_text(RULES)
    ((source, left_out),) = probes(tmp_path).values()
    assert left_out == []
    assert source.decode().count("_compared('executive/rules.py:") == 2
    assert ast.dump(ast.parse(source)).count("LtE()") == 0
    assert len(source.splitlines()) == len(RULES.splitlines())


def test_a_sample_has_as_many_of_each_kind_and_is_that_of_its_seed() -> None:
    drawn = sample(CHECKOUT, 35, 1)
    assert Counter(each.kind for each in drawn) == dict.fromkeys(MutantKind, 5)
    assert drawn == sample(CHECKOUT, 35, 1)
    assert drawn[:7] == sample(CHECKOUT, 7, 1)
    assert set(drawn) != set(sample(CHECKOUT, 35, 2))


def test_equivalent_decisions_are_one_mutant_each() -> None:
    known = mutants.known_equivalents()
    paths = {path for path, *_ in known}
    found = Counter(mutants.key_of(each) for each in mutants_of(CHECKOUT) if each.path in paths)
    assert {key: found[key] for key in known} == dict.fromkeys(known, 1)


def test_code_exercised_by_a_recording_is_detected(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recordings = tmp_path / "recordings"
    recordings.mkdir()
    with closing(RunFile(recordings / "drive.mcap")) as tape, Bench(tmp_path, tape=tape) as bench:
        bench.execute(MoveForward(0.5), 1)
        bench.executive.close()
    noticed = mutant("executive/motion/arbiter.py", "+ pass", of="self._driver.commit(")
    missed = mutant("executive/obstacles/detour.py", "+ pass", of="push_next(lines(start, ")
    monkeypatch.setattr(mutants, "sample", lambda *_: [noticed, missed])
    shown: list[str] = []
    figures = {f.name: f for f in mutants.measure(2, 1, recordings, shown.append)}
    assert figures["mutants: noticed"].value == 50.0
    assert not figures["mutants: noticed"].met
    assert figures["mutants: reached by a recording"].value == 1
    assert figures["mutants: no change, noticed"].value == 0
    (survivor,) = (line for line in shown if line.startswith("not noticed"))
    assert survivor.splitlines() == [
        f"not noticed, not reached: {missed}",
        "    - push_next(lines(start, 0.0, None))",
        "    + pass",
    ]


def mutant(path: str, added: str, of: str) -> Mutant:
    """Return the mutant of a file that has a line in place of one that begins so."""
    source = (CHECKOUT / path).read_bytes()
    of_file = (each for each in mutants_of(CHECKOUT) if each.path == path)
    (found,) = (
        each
        for each in of_file
        if (lines := each.diff(source))[0].startswith(f"- {of}") and lines[-1] == added
    )
    return found
