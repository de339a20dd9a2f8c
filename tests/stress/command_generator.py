"""Random commands, all that a rover knows: each depends on seed and number alone."""

from collections.abc import Callable
from math import inf, nan
from random import Random
from typing import Final

from executive.commands.catalogue import (
    AbortPlan,
    ActivatePlan,
    Arrival,
    Command,
    DeleteFile,
    DriveFor,
    ExecuteAction,
    FollowPath,
    MoveCameraAngles,
    MoveFile,
    MoveForward,
    MoveTo,
    PlanDefinition,
    RemovePlan,
    Request,
    Resume,
    ResumePlan,
    RotateBy,
    SetCameraAngles,
    SetTravelSpeed,
    Stop,
    SubmitPlan,
    SuspendPlan,
    TakePicture,
    Waypoint,
)
from executive.reports import Identity

SOURCE: Final = "KILLS"
SMALL_FILES: Final = 1000
"""Small files aboard, to be moved and deleted."""
PER_PLAN: Final = 25
"""Commands in a row that, if they are about a plan, are about the same one."""
ODD: Final = (nan, inf, -0.0, 1e9)
PLAN: Final = b"""\
<root BTCPP_format="4">
  <BehaviorTree ID="Look">
    <Sequence>
      <moveForward distance="0.2" deadline_s="10"/>
      <takePicture deadline_s="10"/>
      <rotateBy angle="0.4" deadline_s="10"/>
    </Sequence>
  </BehaviorTree>
</root>
"""
Make = Callable[[], Request]


def small_file(number: int) -> str:
    return f"errands/{number % SMALL_FILES}.txt"


def random_command(seed: int, number: int, link: str, utc_s: float) -> Command:
    """Return the command that has this number, made at a time for a link."""
    random = Random(f"{seed} {number}")
    return Command(
        identity=Identity(SOURCE, number),
        request=random_request(random, number),
        link=link,
        created_utc_s=utc_s,
        lifetime_s=random.choice((None, None, None, random.uniform(1.0, 10.0))),
        arrival=random.choice((Arrival.APPEND, Arrival.REPLACE, Arrival.REPLACE)),
    )


def random_request(random: Random, number: int, odd: float = 0.0) -> Request:
    """Return a motion, a plan or something else.

    Args:
        number: of the command: what it has of files and plans, others have had.
        odd: part of the figures that make no sense.
    """

    def near(most: float) -> float:
        return random.choice(ODD) if random.random() < odd else random.uniform(-most, most)

    def waypoint() -> Waypoint:
        return Waypoint(near(1.0), near(1.0), random.choice((None, near(3.0))))

    moved, plan = random.randrange(max(number, 1)), f"plan-{number // PER_PLAN}"
    motions: tuple[Make, ...] = (
        lambda: MoveForward(near(0.5)),
        lambda: RotateBy(near(1.0)),
        lambda: DriveFor(near(0.4), near(0.5), abs(near(1.5))),
        lambda: MoveTo(waypoint()),
        lambda: FollowPath(tuple(waypoint() for _ in range(random.randrange(4)))),
    )
    others: tuple[Make, ...] = (
        Stop,
        Resume,
        Resume,
        lambda: SetTravelSpeed(abs(near(1.0))),
        lambda: SetCameraAngles(near(0.5), random.choice((None, near(0.2)))),
        lambda: MoveCameraAngles(near(0.2), near(0.1)),
        TakePicture,
        TakePicture,
        lambda: MoveFile(small_file(number), f"moved/{number % SMALL_FILES}.txt"),
        lambda: DeleteFile(f"moved/{moved % SMALL_FILES}.txt"),
        lambda: ExecuteAction(random.choice(("VIDEO ON", "VIDEO OFF"))),
    )
    plans: tuple[Make, ...] = (
        lambda: SubmitPlan(PlanDefinition(plan, "look", "BTCPP4", PLAN)),
        lambda: ActivatePlan(plan),
        lambda: ActivatePlan(plan),
        lambda: random.choice((SuspendPlan, ResumePlan, AbortPlan, RemovePlan))(plan),
    )
    if number % PER_PLAN == 1:
        return plans[0]()
    return random.choice(random.choice((motions, motions, others, others, plans)))()
