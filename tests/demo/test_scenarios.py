"""The scenarios of the demonstration: they can be played where they are played."""

from collections.abc import Iterator
from itertools import pairwise
from math import hypot

import pytest
from click.testing import CliRunner

from executive.commands.catalogue import FollowPath, MoveForward, MoveTo
from executive.settings import config_folder
from executive.values.geometry import Point, Pose
from executive.values.reports import Stage
from sim.demo.commands import SHOWS, demo
from sim.drawing.map import HALF_LENGTH_M, HALF_WIDTH_M
from sim.scenario.commands import scenario
from sim.scenario.expect_commands import LifecycleExpectation
from sim.scenario.model import Outage, Repeat, RunMode, Scenario, Send
from sim.scenario.reading import load_scenario
from tests.support.patience import shipped_names

CLEARANCE_M = hypot(HALF_LENGTH_M, HALF_WIDTH_M) + 0.1
FOLDER = config_folder() / "demo"
NAMES = [name for names in SHOWS.values() for name in names]


def load(name: str) -> Scenario:
    mode = RunMode.RELAY if name == "relay" else RunMode.DIRECT
    return load_scenario(str(FOLDER / f"{name}.yaml"), mode)


def distance_m(position: Point, start: Point, end: Point) -> float:
    """Return how near a straight way passes by a place."""
    along = (end.x_m - start.x_m, end.y_m - start.y_m)
    across = (position.x_m - start.x_m, position.y_m - start.y_m)
    part = (across[0] * along[0] + across[1] * along[1]) / (along[0] ** 2 + along[1] ** 2)
    part = max(0.0, min(1.0, part))
    return position.distance_m(Point(start.x_m + part * along[0], start.y_m + part * along[1]))


def stations(played: Scenario) -> Iterator[Pose]:
    """Yield where the rover is, and where it goes."""
    pose = played.world.start_pose
    yield pose
    ends = {
        each.command: each.ends for each in played.expect if isinstance(each, LifecycleExpectation)
    }
    for entry in played.timeline:
        if isinstance(entry, Send) and isinstance(entry.command, MoveTo | FollowPath | MoveForward):
            if ends[entry.name] not in (Stage.EXECUTED, Stage.CANCELLED, None):
                continue
            for segment in entry.command.segments(pose):
                pose = segment.end
                yield pose


def test_each_file_is_played_by_one_demonstration() -> None:
    assert shipped_names(FOLDER) == sorted(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_the_route_is_clear_of_rocks(name: str) -> None:
    played = load(name)
    route = [each.point for each in stations(played)]
    # What `rover demo --stay` proposes to try from where it ends.
    if name == "jackal":
        route.append(Point(3.0, 2.0))
    assert len(set(route)) > 2
    for start, end in pairwise(route):
        for rock in played.world.all_rocks if start != end else ():
            passed_m = distance_m(Point(rock.x_m, rock.y_m), start, end) - rock.radius_m
            assert passed_m > CLEARANCE_M, (start, end, rock)


@pytest.mark.parametrize("name", NAMES)
def test_each_command_is_expected_to_end_somehow(name: str) -> None:
    played = load(name)
    sent = [entry.name for entry in played.timeline if isinstance(entry, Send)]
    assert sent == [
        each.command for each in played.expect if isinstance(each, LifecycleExpectation)
    ]


@pytest.mark.parametrize("name", ["jackal", "mocup", "delayed"])
def test_it_holds_in_lock_step(name: str) -> None:
    played = CliRunner().invoke(scenario, [str(FOLDER / f"{name}.yaml")])
    assert played.exit_code == 0, played.output


def test_an_eclipse_is_between_commands_that_go_and_commands_that_wait() -> None:
    played = load("relay")
    (eclipse,) = (entry for entry in played.timeline if isinstance(entry, Outage))
    assert eclipse.at_s is not None
    end_s = eclipse.at_s + eclipse.outage_s
    sends = [entry for entry in played.timeline if isinstance(entry, Send)]
    waiting = [each for each in sends if each.at_s and eclipse.at_s < each.at_s < end_s]
    assert 0 < len(waiting) < len(sends)
    assert waiting[0].at_s is not None
    assert waiting[0].lifetime_s is not None
    assert waiting[0].at_s + waiting[0].lifetime_s < end_s
    last = played.timeline[-1]
    assert isinstance(last, Repeat)
    assert last.link == "direct"


def test_the_relay_is_played_at_real_time() -> None:
    refused = CliRunner().invoke(demo, ["--relay", "--speed", "2"])
    assert refused.exit_code == 2
    assert "--speed does not work with --relay" in refused.output


@pytest.mark.parametrize(
    "options", [("--mocup", "--relay"), ("--relay", "--assets"), ("--mocup", "--assets")]
)
def test_two_demonstrations_at_once_are_refused(options: tuple[str, str]) -> None:
    refused = CliRunner().invoke(demo, options)
    assert refused.exit_code == 2
    assert f"{' and '.join(options)} are demonstrations of their own" in refused.output
