"""The pages hang together: links lead somewhere, examples are true."""

import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml
from PIL import Image
from py_trees.common import Status

from executive.clock import ManualClock
from executive.commands import catalogue
from executive.commands.catalogue import Command
from executive.commands.lifecycle import Lifecycle
from executive.geometry import STANDING, Pose
from executive.goals import Context, Goals
from executive.motion.velocity_control import VelocityLocomotion
from executive.reports import Identity
from executive.settings import load_settings
from executive.state.files import FileFolder
from executive.state.status import Odometry
from executive.state.status import Status as RoverStatus
from tests.docs.pages import CHECKOUT, PAGES, blocks
from trees import motion
from trees.leaf import GoalLeaf

LINKED = [*PAGES, CHECKOUT / "ARCHITECTURE.md", CHECKOUT / "CONTRIBUTING.md"]
PRIMITIVE = CHECKOUT / "docs" / "add-a-primitive.md"
IMAGES = CHECKOUT / "docs" / "images"


def anchor(heading: str) -> str:
    """Return the anchor that a heading gets on the usual hosts."""
    kept = re.sub(r"[^\w\- ]", "", heading.strip().lower())
    return kept.replace(" ", "-")


@pytest.mark.parametrize("page", LINKED, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text()):
        if target.startswith("http"):
            continue
        path, _, place = target.partition("#")
        linked = (page.parent / path).resolve() if path else page
        assert linked.exists(), target
        if place:
            headings = re.findall(r"^#+ (.*)$", linked.read_text(), re.MULTILINE)
            assert place in map(anchor, headings), target


@pytest.mark.parametrize("page", LINKED, ids=lambda page: page.name)
def test_files_that_are_named_exist(page: Path) -> None:
    rooms = r"(?:executive|trees|adapters|sim|tests|config|docs)"
    for name in re.findall(rf"`({rooms}/[\w./-]+?)/?`", page.read_text()):
        if "scout" not in name:
            assert (CHECKOUT / name).exists(), f"{page.name} names {name}"


def test_every_page_is_in_the_index() -> None:
    index = (CHECKOUT / "docs" / "README.md").read_text()
    for page in PAGES[1:]:
        assert page.name == "README.md" or f"]({page.name})" in index


def test_pictures_are_small_and_decode() -> None:
    total = 0
    for path in IMAGES.iterdir():
        total += path.stat().st_size
        if path.suffix == ".svg":
            ElementTree.fromstring(path.read_text())
        else:
            with Image.open(path) as picture:
                picture.load()
    assert 0 < total < 300_000


def test_the_primitive_of_the_page_works(tmp_path: Path) -> None:
    request, leaf = blocks(PRIMITIVE, "python")
    room = {**vars(catalogue), **vars(motion)}
    exec(request, room)
    exec(leaf, room)
    clock, settings = ManualClock(), load_settings("jackal")
    status = RoverStatus(clock, settings)
    context = Context(
        clock,
        settings,
        status,
        Goals(clock),
        VelocityLocomotion(clock, settings, status),
        FileFolder(tmp_path, lambda _: None),
    )
    context.status.observe(Odometry(0.0, Pose(), STANDING))
    life = Lifecycle(lambda *_: None).receive(
        Command(Identity("MOE", 1), room["Wait"](2.0), "direct")
    )
    life.accept()
    context.goals.motion.add(life)
    stand_by: GoalLeaf = room["StandBy"]("stand by", context)
    context.goals.motion.take()
    for now_s, expected in ((0.0, Status.RUNNING), (1.9, Status.RUNNING), (2.0, Status.SUCCESS)):
        clock.set(now_s)
        stand_by.tick_once()
        assert stand_by.status is expected
        assert context.intents.motion == STANDING
    assert life.stage.name == "EXECUTED"


def test_the_scenario_of_the_page_is_one() -> None:
    (text,) = blocks(PRIMITIVE, "yaml")
    scenario = yaml.safe_load(text)
    assert {"title", "lasts", "timeline", "expect"} == set(scenario)
