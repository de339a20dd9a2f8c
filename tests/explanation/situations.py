"""Situations with one cause each, on a rover without physics, and what `why` has to say of them."""

from collections.abc import Callable
from dataclasses import replace
from math import nan
from typing import Any, Final

from executive.commands import (
    RELAY_LINK,
    ActivatePlan,
    Command,
    ConfirmPose,
    DeleteFile,
    ExecuteAction,
    FollowPath,
    Mode,
    MoveFile,
    MoveForward,
    MoveTo,
    OnlyAt,
    PlanDefinition,
    Precondition,
    Request,
    Resume,
    SetCameraAngles,
    SetTravelSpeed,
    Stop,
    SubmitPlan,
    SuspendPlan,
    TakePicture,
    Waypoint,
)
from executive.core.authority import AuthorityAction, AuthorityRequest
from executive.faults import ClearPolicy, Reaction
from executive.obstacles.zones import KnownRock, Zones
from executive.settings import AuthoritySettings, LinkLossSettings, Settings, structure
from executive.values.facts import ExternalCommandEnded, ExternalStop, ForeignPublishers, Odometry
from executive.values.geometry import STANDING, Pose
from executive.values.reasons import Reason, Refusal
from executive.values.reports import Identity
from tests.core.test_pose_uncertainty import jump
from tests.explanation.case import JACKAL, Case
from tests.support.kinematic import Bench
from tests.support.plans import AHEAD, plan


def _send(request: Request, number: int = 1, **options: Any) -> Callable[[Bench], object]:
    return lambda bench: bench.submit(request, number, **options)


def _refused(reason: Reason, request: Request, message: str = "", **options: Any) -> Case:
    return Case(f"refused {reason.name}", _send(request, 1, **options), "MOE:1", reason, message)


def _after_a_jump(bench: Bench) -> None:
    bench.run(1.0)
    jump(bench, x_m=0.5)
    bench.submit(MoveTo(Waypoint(1.0, 0.0)), 1)


def _confirmed_in_part(bench: Bench) -> None:
    """Of what became certain again, the cause is not told."""
    bench.run(1.0)
    jump(bench, x_m=0.5)
    for number, left_m in ((2, 0.0), (3, 0.4)):
        bench.submit(ConfirmPose(left_m, 0.0), number)
        bench.run(0.2)
    bench.submit(MoveTo(Waypoint(1.0, 0.0)), 1)


def _after_a_refused_one(bench: Bench) -> None:
    bench.submit(MoveForward(1e6), 2)
    bench.submit(MoveForward(1.0), 1, precondition=Precondition(after=2))


def _old(bench: Bench) -> None:
    made_s = bench.clock.utc_s() - 10.0
    bench.submit(MoveForward(1.0), 1, created_utc_s=made_s, lifetime_s=5.0)


def _early(bench: Bench) -> None:
    bench.submit(MoveForward(1.0), 1, created_utc_s=bench.clock.utc_s() + 60.0)


def _as_a_plan(bench: Bench) -> None:
    bench.send(Command(Identity("plan:x", 1), MoveForward(1.0), "direct"))


def _blind(bench: Bench) -> None:
    bench.odometry = False
    bench.run(1.0)
    bench.submit(MoveForward(1.0), 1)


def _stopped(bench: Bench) -> None:
    bench.submit(Stop(), 8)
    bench.run(1.0)


def _while_stopped(bench: Bench) -> None:
    _stopped(bench)
    bench.submit(MoveForward(1.0), 1)


def _lose_odometry(bench: Bench) -> None:
    bench.drive_on()
    bench.odometry = False
    bench.run(0.5)


def _resume_too_early(bench: Bench) -> None:
    _lose_odometry(bench)
    bench.submit(Resume(), 2)


def _without_authority(bench: Bench) -> None:
    requested = AuthorityRequest(AuthorityAction.REQUEST, "ELSE")
    bench.executive.request_authority(requested, lambda _: None)
    bench.submit(MoveForward(1.0), 1)


def _number_twice(bench: Bench) -> None:
    bench.submit(MoveForward(1.0), 1)
    bench.submit(MoveForward(2.0), 1)


def _too_many(bench: Bench) -> None:
    for number in range(2, 2 + bench.settings.drive.queue_length):
        bench.submit(MoveForward(0.1), number)
    bench.submit(MoveForward(1.0), 1)


def _target_exists(bench: Bench) -> None:
    bench.executive.files.root.mkdir(parents=True, exist_ok=True)
    for name in ("a.jpg", "b.jpg"):
        (bench.executive.files.root / name).write_bytes(b"x")
    bench.submit(MoveFile("a.jpg", "b.jpg"), 1)


def _short(bench: Bench) -> None:
    bench.charge_ratio = 0.101
    bench.run(0.1)
    bench.submit(MoveTo(Waypoint(30.0, 0.0)), 1)


def _stopped_by(bench: Bench) -> None:
    bench.drive_on()
    bench.send(Command(Identity("LAB", 7), Stop(), RELAY_LINK))
    bench.run(1.0)


def _replaced(bench: Bench) -> None:
    bench.drive_on()
    bench.replace(MoveForward(-1.0), 2)
    bench.run(0.5)


def _expired_waiting(bench: Bench) -> None:
    bench.submit(MoveForward(3.0), 2)
    bench.submit(MoveForward(1.0), 1, lifetime_s=1.0)
    bench.finish(1)


def _crashed(bench: Bench) -> None:
    bench.drive_on()
    bench.crash()
    bench.run(0.2)


def _crashed_waiting(bench: Bench) -> None:
    bench.submit(MoveForward(3.0), 2)
    bench.submit(MoveForward(1.0), 1)
    bench.run(0.5)
    bench.crash()
    bench.run(0.2)


def _closed(bench: Bench) -> None:
    bench.drive_on()
    bench.executive.close()


def _jumped(bench: Bench) -> None:
    bench.drive_on()
    bench.rover.pose = replace(bench.rover.pose, y_m=bench.rover.pose.y_m + 0.5)
    bench.run(0.1)


def _tilted(bench: Bench) -> None:
    bench.drive_on()
    leaning = replace(bench.rover.pose, roll_rad=0.6)
    bench.executive.observe(Odometry(bench.clock.now_s(), leaning, bench.rover.velocity))
    bench.executive.tick()


def _no_numbers(bench: Bench) -> None:
    bench.drive_on()
    bench.odometry = False
    for _ in range(8):
        bench.step()
        bench.executive.observe(Odometry(0.0, Pose(nan, 0.0), STANDING))


def _frozen(bench: Bench) -> None:
    bench.submit(MoveForward(3.0), 1)
    bench.odometry = False
    for _ in range(30):
        bench.executive.observe(Odometry(bench.clock.now_s(), Pose(), STANDING))
        bench.step()


def _low_battery(bench: Bench) -> None:
    bench.drive_on()
    bench.voltage_v = 20.0
    bench.run(0.5)


def _hung(bench: Bench) -> None:
    bench.drive_on()
    bench.executive.enter_safe_mode(Refusal(Reason.CORE_HUNG, "the core hung for 2 s"))
    bench.run(0.2)


def _adapter_raised(bench: Bench) -> None:
    bench.drive_on()
    bench.executive.enter_safe_mode(Refusal(Reason.ADAPTER_RAISED, "an adapter raised KeyError"))
    bench.run(0.2)


def _dead_camera(bench: Bench) -> None:
    bench.rover.camera_works = False
    bench.submit(TakePicture(), 1)
    bench.finish(1)


def _stuck_camera(bench: Bench) -> None:
    bench.rover.lazy_camera = True
    bench.submit(SetCameraAngles(2.0, 0.0), 1)
    for _ in range(1000):
        bench.rover.camera_speed_radps = 0.0
        bench.step()
        if bench.stages(1)[-1].terminal:
            return


def _stopped_by_other(bench: Bench) -> None:
    bench.drive_on()
    bench.executive.observe(ExternalStop(Identity("ORBITER", 3)))
    bench.run(0.2)


def _done_by_other(bench: Bench) -> None:
    bench.drive_on()
    bench.executive.observe(ExternalCommandEnded(Identity("MOE", 1), False, "the brick refused"))
    bench.run(0.2)


def _unheard(bench: Bench) -> None:
    bench.drive_on(3.0)


def _held(bench: Bench) -> None:
    bench.submit(MoveForward(1.0), 2)
    bench.submit(MoveForward(1.0), 1)
    bench.run(8.0)


def _waits(bench: Bench) -> None:
    bench.submit(MoveForward(5.0), 2)
    bench.submit(MoveForward(1.0), 1)
    bench.run(1.0)


def _waited(bench: Bench) -> None:
    bench.submit(MoveForward(1.0), 2)
    bench.submit(MoveForward(1.0), 1)
    bench.finish(1)


def _joystick(bench: Bench) -> None:
    bench.executive.observe(ForeignPublishers(("/joystick",)))
    bench.run(0.2)


def _slow(bench: Bench) -> None:
    bench.submit(SetTravelSpeed(0.3), 7)
    bench.execute(MoveForward(1.0), 1)


def _plan_stopped(bench: Bench) -> None:
    bench.submit(SubmitPlan(plan(AHEAD)), 5)
    bench.submit(ActivatePlan("survey"), 6)
    bench.run(1.0)
    bench.submit(SuspendPlan("survey"), 7)
    bench.run(1.0)


def _while_planned(bench: Bench) -> None:
    bench.submit(SubmitPlan(plan(AHEAD)), 5)
    bench.submit(ActivatePlan("survey"), 6)
    bench.run(1.0)
    bench.submit(MoveForward(1.0), 1)


def _active(bench: Bench) -> None:
    bench.drive_on()


def _idle(bench: Bench) -> None:
    bench.execute(MoveForward(0.3), 1)


def _with_loss(**stages: object) -> Settings:
    return replace(JACKAL, link_loss=structure(stages, LinkLossSettings, "jackal.yaml"))


_ROCK: Final = replace(JACKAL, zones=Zones(rocks=(KnownRock("boulder", 3.0, 0.0, 0.5),)))
_AUTHORITY: Final = replace(JACKAL, authority=AuthoritySettings(needed=True))
_SLOWED: Final = replace(
    JACKAL,
    faults=replace(
        JACKAL.faults,
        battery_low=replace(
            JACKAL.faults.battery_low, reaction=Reaction.SLOW_DOWN, clears=ClearPolicy.AUTO
        ),
    ),
)
_PAUSED: Final = replace(
    JACKAL,
    faults=replace(
        JACKAL.faults,
        battery_low=replace(
            JACKAL.faults.battery_low, reaction=Reaction.PAUSE, clears=ClearPolicy.AUTO
        ),
    ),
)
_NOT_XML: Final = PlanDefinition("survey", "", "BTCPP4", b"no plan")


def _paused_waiting(bench: Bench) -> None:
    bench.voltage_v = 20.0
    bench.run(0.5)
    bench.submit(MoveForward(1.0), 1)
    bench.run(1.0)


def _paused_for_a_while(bench: Bench) -> None:
    _paused_waiting(bench)
    bench.voltage_v = 26.0
    bench.finish(1)


CASES: Final = (
    _refused(Reason.NOT_FINITE, MoveForward(nan)),
    _refused(Reason.OUT_OF_RANGE, MoveForward(1000.0), "bound of 100 m"),
    _refused(Reason.EMPTY_PATH, FollowPath(())),
    _refused(Reason.BAD_PATH, DeleteFile("../x")),
    _refused(Reason.NOT_SUPPORTED, TakePicture(format="PNG")),
    _refused(Reason.UNKNOWN_ACTION, ExecuteAction("dance")),
    _refused(Reason.NO_SUCH_FILE, DeleteFile("none.jpg")),
    _refused(Reason.NO_SUCH_PLAN, ActivatePlan("none")),
    _refused(Reason.PLAN_NOT_XML, SubmitPlan(_NOT_XML)),
    _refused(Reason.PLAN_NO_DEADLINE, SubmitPlan(plan('<moveForward distance="1"/>'))),
    Case("refused EXPIRED", _old, "MOE:1", Reason.EXPIRED, "its lifetime is 5 s"),
    Case("refused CREATED_IN_FUTURE", _early, "MOE:1", Reason.CREATED_IN_FUTURE),
    Case("refused BAD_IDENTIFIER", _as_a_plan, "plan:x:1", Reason.BAD_IDENTIFIER),
    Case("refused NO_ODOMETRY", _blind, "MOE:1", Reason.NO_ODOMETRY),
    Case("refused WRONG_MODE when stopped", _while_stopped, "MOE:1", Reason.WRONG_MODE, "MOE:8"),
    Case("refused WRONG_MODE in a plan", _while_planned, "MOE:1", Reason.WRONG_MODE, "PLAN"),
    Case("refused CAUSE_PERSISTS", _resume_too_early, "MOE:2", Reason.CAUSE_PERSISTS),
    Case(
        "refused NO_AUTHORITY",
        _without_authority,
        "MOE:1",
        Reason.NO_AUTHORITY,
        "ELSE holds it",
        _AUTHORITY,
    ),
    Case("number used twice", _number_twice, "MOE:1", None, "MOE:1 is used by another command"),
    Case("refused QUEUE_FULL", _too_many, "MOE:1", Reason.QUEUE_FULL),
    Case("refused TARGET_EXISTS", _target_exists, "MOE:1", Reason.TARGET_EXISTS),
    Case(
        "refused PATH_BLOCKED",
        _send(MoveForward(5.0)),
        "MOE:1",
        Reason.PATH_BLOCKED,
        "boulder",
        _ROCK,
    ),
    Case(
        "refused POSE_UNCERTAIN",
        _after_a_jump,
        "MOE:1",
        Reason.POSE_UNCERTAIN,
        "alarm: odometry jumped by 0.50 m",
    ),
    Case("now: uncertain", _after_a_jump, None, Reason.POSE_UNCERTAIN, "confirmPose 0 0"),
    Case(
        "refused POSE_UNCERTAIN since confirmed",
        _confirmed_in_part,
        "MOE:1",
        Reason.POSE_UNCERTAIN,
        "MOE requested confirmPose",
    ),
    _refused(
        Reason.PRECONDITION_POSE,
        MoveForward(1.0),
        "only at x 2.00 m, y 0.00 m within 0.5 m, but 2.00 m away",
        precondition=Precondition(at=OnlyAt(2.0, 0.0, 0.5)),
    ),
    Case(
        "refused PRECONDITION_COMMAND",
        _after_a_refused_one,
        "MOE:1",
        Reason.PRECONDITION_COMMAND,
        "MOE:2 was refused: distance 1e+06 m is above",
    ),
    _refused(
        Reason.PRECONDITION_MODE,
        MoveForward(1.0),
        "the rover was IDLE",
        precondition=Precondition(mode=Mode.MOVING),
    ),
    Case("refused BATTERY_INSUFFICIENT", _short, "MOE:1", Reason.BATTERY_INSUFFICIENT),
    Case(
        "stopped by another",
        _stopped_by,
        "MOE:1",
        Reason.STOPPED,
        "LAB requested stop over the relay link",
    ),
    Case(
        "replaced", _replaced, "MOE:1", Reason.REPLACED, "MOE requested moveForward distance -1 m"
    ),
    Case("expired waiting", _expired_waiting, "MOE:1", Reason.EXPIRED, "for MOE:2 moveForward"),
    Case("crashed", _crashed, "MOE:1", Reason.INTERRUPTED, "restarted"),
    Case("crashed waiting", _crashed_waiting, "MOE:1", Reason.INTERRUPTED, "restarted"),
    Case("shut down", _closed, "MOE:1", Reason.INTERRUPTED, "shut down", ends=True),
    Case("odometry lost", _lose_odometry, "MOE:1", Reason.ODOMETRY_STALE),
    Case("odometry jumped", _jumped, "MOE:1", Reason.ODOMETRY_JUMPED),
    Case("odometry without numbers", _no_numbers, "MOE:1", Reason.ODOMETRY_NOT_FINITE),
    Case("odometry frozen", _frozen, "MOE:1", Reason.ODOMETRY_FROZEN),
    Case("tilted", _tilted, "MOE:1", Reason.TILT_LIMIT),
    Case("battery low", _low_battery, "MOE:1", Reason.BATTERY_LOW),
    Case("core hung", _hung, "MOE:1", Reason.CORE_HUNG),
    Case("adapter raised", _adapter_raised, "MOE:1", Reason.ADAPTER_RAISED),
    Case("camera dead", _dead_camera, "MOE:1", Reason.CAPTURE_DEADLINE),
    Case("camera stuck", _stuck_camera, "MOE:1", Reason.PAN_TILT_DEADLINE),
    Case("stopped by another way", _stopped_by_other, "MOE:1", Reason.STOPPED, "ORBITER:3"),
    Case("ended by another way", _done_by_other, "MOE:1", Reason.MOTION_NOT_EXECUTED),
    Case(
        "link lost",
        _unheard,
        "MOE:1",
        Reason.LINK_LOST,
        settings=_with_loss(motion=[{"after_s": 1, "then": "stop"}]),
    ),
    Case(
        "held as the link is lost",
        _held,
        "MOE:1",
        None,
        "no contact with the ground",
        _with_loss(motion=[{"after_s": 1, "then": "hold"}]),
    ),
    Case("waits for another", _waits, "MOE:1", None, "for MOE:2 moveForward"),
    Case("waited for another", _waited, "MOE:1", None, "for MOE:2 moveForward"),
    Case("waits while paused", _paused_waiting, "MOE:1", Reason.BATTERY_LOW, "PAUSED", _PAUSED),
    Case("waited while paused", _paused_for_a_while, "MOE:1", None, "(FAULT_CLEARED 909)", _PAUSED),
    Case("limited by a setting", _slow, "MOE:1", None, "0.30 m/s"),
    Case("slowed by a fault", _low_battery, "MOE:1", None, "slowed down", _SLOWED),
    Case("under way", _active, "MOE:1", None, "leaf drive ran for 1.00 s"),
    Case("now: stopped", _stopped, None, Reason.STOPPED, "MOE requested stop"),
    Case("now: odometry lost", _lose_odometry, None, Reason.ODOMETRY_STALE),
    Case("now: tilted", _tilted, None, Reason.TILT_LIMIT),
    Case("now: jumped", _jumped, None, Reason.ODOMETRY_JUMPED),
    Case("now: core hung", _hung, None, Reason.CORE_HUNG),
    Case("now: paused", _paused_waiting, None, Reason.BATTERY_LOW, "PAUSED", _PAUSED),
    Case(
        "now: link lost",
        _unheard,
        None,
        Reason.LINK_LOST,
        settings=_with_loss(motion=[{"after_s": 1, "then": "stop"}]),
    ),
    Case("now: no odometry", _blind, None, Reason.NO_ODOMETRY, "no odometry"),
    Case("now: joystick", _joystick, None, None, "/joystick"),
    Case("now: drives", _active, None, None, "for MOE:1 moveForward"),
    Case("now: plan suspended", _plan_stopped, None, None, "plan survey is suspended"),
    Case("now: nothing to do", _idle, None, None, "no motion goal"),
)
