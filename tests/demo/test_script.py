"""The session as data: it can be played where it is played, and reads as people would say it."""

from itertools import pairwise
from math import hypot, radians

import pytest

from executive.commands import FollowPath, MoveTo, SetCameraAngles, Stop, TakePicture, Waypoint
from executive.geometry import Point
from executive.settings import config_folder, load_settings
from sim.demo.marks import HALF_LENGTH_M, HALF_WIDTH_M
from sim.demo.script import JACKAL, MOCUP, Ending, Script, WhenDone, spelled
from sim.world import load_world

CLEARANCE_M = hypot(HALF_LENGTH_M, HALF_WIDTH_M) + 0.1


def distance_m(place: Point, start: Point, end: Point) -> float:
    """Return how near a straight way passes by a place."""
    along = (end.x_m - start.x_m, end.y_m - start.y_m)
    across = (place.x_m - start.x_m, place.y_m - start.y_m)
    part = (across[0] * along[0] + across[1] * along[1]) / (along[0] ** 2 + along[1] ** 2)
    part = max(0.0, min(1.0, part))
    return place.distance_m(Point(start.x_m + part * along[0], start.y_m + part * along[1]))


SCRIPTS = pytest.mark.parametrize("script", [JACKAL, MOCUP], ids=lambda script: script.asset)


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
def test_the_script_shows_what_it_promises(script: Script) -> None:
    endings = [step.expected for step in script.steps]
    assert {Ending.CANCELLED, Ending.REJECTED, Ending.DUPLICATE} < set(endings)
    requests = [type(step.request) for step in script.steps]
    assert {Stop, SetCameraAngles, TakePicture} < set(requests)
    assert sum(step.repeats for step in script.steps) == 1
    assert isinstance(script.steps[0].cue, WhenDone)


@SCRIPTS
def test_the_route_is_what_the_script_drives(script: Script) -> None:
    driven: list[Waypoint] = []
    for step in script.steps:
        if step.expected is Ending.EXECUTED:
            match step.request:
                case MoveTo(target):
                    driven.append(target)
                case FollowPath(waypoints):
                    driven += waypoints
                case _:
                    pass
    assert tuple(driven) == script.route


@SCRIPTS
def test_only_the_one_far_away_is_out_of_range(script: Script) -> None:
    bound_m = load_settings(script.asset).drive.distance_m
    for step in script.steps:
        if isinstance(step.request, MoveTo):
            far = hypot(step.request.target.x_m, step.request.target.y_m) > bound_m
            assert far == (step.expected is Ending.REJECTED)


def test_requests_are_spelled_for_people() -> None:
    assert spelled(MoveTo(Waypoint(3.0, 2.0, radians(-15)))) == "moveTo 3,2,-15°"
    assert spelled(MoveTo(Waypoint(500.0, 0.0))) == "moveTo 500,0"
    assert spelled(SetCameraAngles(radians(60), None)) == "setAngles 60°"
    assert spelled(FollowPath((Waypoint(1, 0), Waypoint(1, 1, 0.0)))) == "followPath 1,0 1,1,0°"
    assert spelled(Stop()) == "stop"
    assert spelled(TakePicture()) == "takePicture"
