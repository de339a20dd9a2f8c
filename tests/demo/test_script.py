"""The session as data: it can be played where it is played, and reads as people would say it."""

from itertools import pairwise
from math import hypot, radians

import pytest
from click.testing import CliRunner

from executive.commands.catalogue import (
    FollowPath,
    MoveTo,
    SetCameraAngles,
    Stop,
    TakePicture,
    Waypoint,
)
from executive.settings import config_folder
from executive.values.geometry import Point
from sim.demo.commands import demo
from sim.demo.script import (
    ASSETS,
    JACKAL,
    MOCUP,
    RELAY,
    SHOWS,
    Ending,
    Link,
    Script,
    WhenDark,
    spelled,
)
from sim.drawing.map import HALF_LENGTH_M, HALF_WIDTH_M
from sim.rover.world import load_world

CLEARANCE_M = hypot(HALF_LENGTH_M, HALF_WIDTH_M) + 0.1


def distance_m(place: Point, start: Point, end: Point) -> float:
    """Return how near a straight way passes by a place."""
    along = (end.x_m - start.x_m, end.y_m - start.y_m)
    across = (place.x_m - start.x_m, place.y_m - start.y_m)
    part = (across[0] * along[0] + across[1] * along[1]) / (along[0] ** 2 + along[1] ** 2)
    part = max(0.0, min(1.0, part))
    return place.distance_m(Point(start.x_m + part * along[0], start.y_m + part * along[1]))


SCRIPTS = pytest.mark.parametrize(
    "script",
    [JACKAL, MOCUP, RELAY, *ASSETS],
    ids=["jackal", "mocup", "relay", "jackal by both", "mocup by both"],
)


@SCRIPTS
def test_the_route_keeps_clear_of_rocks(script: Script) -> None:
    world = load_world(config_folder() / "worlds" / f"{script.world}.yaml")
    stations = [world.start_pose.point, *(Point(place.x_m, place.y_m) for place in script.route)]
    # What `rover demo --stay` proposes to try from where it ends.
    if script is JACKAL:
        stations.append(Point(3.0, 2.0))
    for start, end in pairwise(stations):
        for rock in world.all_rocks:
            passed_m = distance_m(Point(rock.x_m, rock.y_m), start, end) - rock.radius_m
            assert passed_m > CLEARANCE_M, (start, end, rock)


@SCRIPTS
def test_the_route_is_what_the_script_drives(script: Script) -> None:
    driven: list[Waypoint] = []
    for step in script.steps:
        if step.expected is Ending.EXECUTED and not step.repeats:
            match step.request:
                case MoveTo(target):
                    driven.append(target)
                case FollowPath(waypoints):
                    driven += waypoints
                case _:
                    pass
    assert tuple(driven) == script.route


def test_an_eclipse_is_between_commands_that_go_and_commands_that_wait() -> None:
    (script,) = SHOWS["relay"].scripts
    dark = next(i for i, step in enumerate(script.steps) if isinstance(step.cue, WhenDark))
    assert all(step.link is Link.RELAY for step in script.steps[: dark + 1])
    assert script.steps[dark].expected is Ending.EXPIRED
    (eclipse,) = SHOWS["relay"].eclipses
    lifetime_s = script.steps[dark].lifetime_s
    assert lifetime_s is not None
    assert lifetime_s < eclipse.end_s - eclipse.begin_s
    assert script.steps[-1].link is Link.DIRECT


def test_requests_are_spelled_for_people() -> None:
    assert spelled(MoveTo(Waypoint(3.0, 2.0, radians(-15)))) == "moveTo 3,2,-15°"
    assert spelled(MoveTo(Waypoint(500.0, 0.0))) == "moveTo 500,0"
    assert spelled(SetCameraAngles(radians(60), None)) == "setCameraAngles 60°"
    assert spelled(FollowPath((Waypoint(1, 0), Waypoint(1, 1, 0.0)))) == "followPath 1,0 1,1,0°"
    assert spelled(Stop()) == "stop"
    assert spelled(TakePicture()) == "takePicture"


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
