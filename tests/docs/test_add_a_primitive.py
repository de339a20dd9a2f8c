"""The page on a new primitive, followed in a copy of the product: everything knows it then."""

import re
import shutil
import sys
from pathlib import Path

from tests.docs.pages import CHECKOUT, blocks
from tests.support.processes import run_to_end

PAGE = CHECKOUT / "docs" / "add-a-primitive.md"
COPIED = ("executive", "trees", "adapters", "sim", "config", "tests/docs", "tests/support")
PLAN = """\
<root BTCPP_format="4" main_tree_to_execute="Rest">
  <BehaviorTree ID="Rest"><Sequence><wait duration="2" deadline_s="9"/></Sequence></BehaviorTree>
</root>
"""
TRY = """
import shlex
from pathlib import Path
from click.testing import CliRunner
from adapters.api import Wait
from adapters.cli.main import main
from executive.settings import load_settings
from tests.docs.interface_page import interface_page
from tests.support.kinematic import Bench

for typed in (
    "command wait --help",
    "plan check rest.xml",
    "scenario wait.yaml --out runs",
    "scenario wait.yaml --set 'settings.zones.rocks=[{name: boulder, x: 5, y: 0, radius: 0.4}]'",
    "replay runs",
):
    result = CliRunner().invoke(main, shlex.split(typed))
    print(result.output)
    assert result.exit_code == 0, typed
assert "| `wait` | Stand for a time. |" in interface_page()
with Bench(Path("."), load_settings("jackal")) as bench:
    run = bench.executive.preview(Wait(5.0))
    run.set_up()
    while not run.advance(10):
        pass
    assert round(run.result.duration_s) == 5
"""


def edit(path: Path, *changes: tuple[str, str]) -> None:
    text = path.read_text()
    for old, new in changes:
        assert old in text, (path, old)
        text = text.replace(old, new, 1)
    path.write_text(text)


def follow(root: Path) -> None:
    request, leaf, row = blocks(PAGE, "python")
    (scenario,) = blocks(PAGE, "yaml")
    catalogue, motion = (
        root / name for name in ("executive/commands/catalogue.py", "trees/motion.py")
    )
    imported = "from executive.commands import "
    import_wait = f"{imported}Wait\n{imported}"
    edit(
        catalogue,
        ("import Arc, Line, Reference, ", "import Arc, Line, Reference, Rest, "),
        ("Motion = ", f"{request}\n\nMotion = Wait | "),
    )
    edit(
        motion,
        (imported, import_wait),
        ("class PlanLeg", f"{leaf}\n\nclass PlanLeg"),
        ('    ("velocity", DriveFor', f'{row}    ("velocity", DriveFor'),
    )
    specification = root / "adapters/mrs/spec/mrs.xml"
    text = specification.read_text()
    found = re.search(r' *<mal:submitIP name="moveForward".*?</mal:submitIP>\n', text, re.DOTALL)
    service = re.search(r'name="MotionControl".*?</mal:service>', text, re.DOTALL)
    assert found is not None
    assert service is not None
    numbers = map(int, re.findall(r'<mal:\w+IP name="\w+" number="(\d+)"', service[0]))
    copied = found[0].replace('"moveForward" number="2"', f'"wait" number="{max(numbers) + 1}"')
    edit(specification, (found[0], found[0] + copied.replace('"distance"', '"duration"')))
    edit(root / "config/mops/dictionary.yaml", ("  stop: ", "  wait: 0x107\n  stop: "))
    (root / "wait.yaml").write_text(scenario)
    (root / "rest.xml").write_text(PLAN)


def test_a_reader_of_the_page_has_a_primitive(tmp_path: Path) -> None:
    for name in COPIED:
        shutil.copytree(CHECKOUT / name, tmp_path / name)
    follow(tmp_path)
    tried = run_to_end(sys.executable, "-c", TRY, cwd=tmp_path, PYTHONPATH=str(tmp_path))
    assert tried.returncode == 0, tried.stdout + tried.stderr
    assert "rover command wait 5" in tried.stdout
    assert tried.stdout.count("passed  command rest  ends EXECUTED") == 2
    assert "passed  command back  ends EXECUTED" in tried.stdout


def test_the_page_fits_on_a_screen() -> None:
    assert len(PAGE.read_text().splitlines()) <= 70
