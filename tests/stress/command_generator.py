"""What a client has the rover do, at random: each command depends on seed and number alone."""

from collections.abc import Callable
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
ERRANDS: Final = 1000
"""Small files aboard, to be moved and deleted."""
PER_PLAN: Final = 25
"""Commands in a row that, if they are about a plan, are about the same one."""
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


def errand_path(number: int) -> str:
    """Return the path of one of the small files."""
    return f"errands/{number % ERRANDS}.txt"


def random_command(seed: int, number: int, link: str, utc_s: float) -> Command:
    """Return the command of a number.

    Args:
        seed: of the campaign.
        number: its `commandId`.
        link: the link that it goes by.
        utc_s: when it is made.
    """
    random = Random(f"{seed} {number}")
    return Command(
        identity=Identity(SOURCE, number),
        request=_request(random, number),
        link=link,
        created_utc_s=utc_s,
        lifetime_s=random.choice((None, None, None, random.uniform(1.0, 10.0))),
        arrival=random.choice((Arrival.APPEND, Arrival.REPLACE, Arrival.REPLACE)),
    )


def _request(random: Random, number: int) -> Request:
    def near(most: float) -> float:
        return random.uniform(-most, most)

    moved, plan = random.randrange(max(number, 1)), f"plan-{number // PER_PLAN}"
    motions: tuple[Callable[[], Request], ...] = (
        lambda: MoveForward(near(0.5)),
        lambda: RotateBy(near(1.0)),
        lambda: DriveFor(near(0.4), near(0.5), random.uniform(0.1, 1.5)),
        lambda: MoveTo(Waypoint(near(1.0), near(1.0))),
        lambda: FollowPath((Waypoint(near(1.0), near(1.0)), Waypoint(near(1.0), near(1.0)))),
    )
    others: tuple[Callable[[], Request], ...] = (
        Stop,
        Resume,
        Resume,
        lambda: SetTravelSpeed(random.uniform(0.2, 1.0)),
        lambda: SetCameraAngles(near(0.5), near(0.2)),
        lambda: MoveCameraAngles(near(0.2), near(0.1)),
        TakePicture,
        TakePicture,
        lambda: MoveFile(errand_path(number), f"moved/{number % ERRANDS}.txt"),
        lambda: DeleteFile(f"moved/{moved % ERRANDS}.txt"),
        lambda: ExecuteAction(random.choice(("VIDEO ON", "VIDEO OFF"))),
    )
    plans: tuple[Callable[[], Request], ...] = (
        lambda: SubmitPlan(PlanDefinition(plan, "look", "BTCPP4", PLAN)),
        lambda: ActivatePlan(plan),
        lambda: ActivatePlan(plan),
        lambda: random.choice((SuspendPlan, ResumePlan, AbortPlan, RemovePlan))(plan),
    )
    if number % PER_PLAN == 1:
        return plans[0]()
    return random.choice(random.choice((motions, motions, others, others, plans)))()
