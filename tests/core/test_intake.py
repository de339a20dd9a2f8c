"""Every request is declared once, and taken only as its declaration allows."""

from dataclasses import FrozenInstanceError, fields, replace
from math import inf, nan
from typing import Any, get_args

import pytest

from executive.commands import (
    ACCEPTED,
    CameraWork,
    Command,
    DriveFor,
    Family,
    FollowPath,
    InstantCommand,
    Mode,
    Motion,
    MoveCameraAngles,
    MoveForward,
    MoveTo,
    PlanRequest,
    Request,
    RotateTo,
    SetCameraAngles,
    SetCameraRotateSpeed,
    SetStatusInterval,
    Setting,
    SetTravelSpeed,
    TakePicture,
    Waypoint,
    all_declarations,
    declaration_of,
)
from executive.commands.intake import check_arguments, check_identity, validate
from executive.plans import LEAVES
from executive.settings import CameraLimits, load_settings
from executive.state import Status
from executive.values.clock import ManualClock
from executive.values.facts import Odometry
from executive.values.geometry import STANDING, Point, Pose
from executive.values.reasons import Figure, Reason, Refusal
from executive.values.reports import Identity
from tests.support.requests import GOOD

SETTINGS = load_settings("jackal")


def poll(
    request: Request,
    mode: Mode = Mode.IDLE,
    queued: int = 0,
    utc_s: float = 1000.0,
    odometry: bool = True,
    **options: float,
) -> Refusal | None:
    status = Status(ManualClock(), SETTINGS)
    if odometry:
        status.observe(Odometry(0.0, Pose(), STANDING))
    command = Command(Identity("MOE", 1), request, "direct", **options)  # type: ignore[arg-type]
    return validate(
        command, settings=SETTINGS, status=status, mode=mode, queued=queued, utc_s=utc_s
    )


def refusal_of(request: Request, **options: Any) -> Refusal:
    refusal = poll(request, **options)
    assert refusal is not None
    return refusal


@pytest.mark.at_length
@pytest.mark.parametrize("request_", GOOD, ids=lambda r: type(r).__name__)
@pytest.mark.parametrize("mode", Mode)
def test_a_good_request_is_accepted_in_its_modes(request_: Request, mode: Mode) -> None:
    refusal = poll(request_, mode)
    if mode in ACCEPTED[declaration_of(type(request_)).family]:
        assert refusal is None
    else:
        assert refusal is not None
        assert refusal.reason is Reason.WRONG_MODE
        assert mode.name in refusal.text


@pytest.mark.parametrize("bad", [nan, inf, -inf])
@pytest.mark.parametrize(
    ("request_", "field"),
    [
        (request, field.name)
        for request in (*GOOD, Waypoint(1.0, 2.0, 0.5, 0.1))
        for field in fields(request)
        if isinstance(getattr(request, field.name), float)
    ],
    ids=str,
)
def test_every_figure_is_finite(request_: Request | Waypoint, field: str, bad: float) -> None:
    broken = replace(request_, **{field: bad})  # type: ignore[arg-type]
    requested: Request = (
        FollowPath((Waypoint(0.0, 0.0), broken)) if isinstance(broken, Waypoint) else broken
    )
    refusal = refusal_of(requested)
    assert refusal.reason is Reason.NOT_FINITE
    assert refusal.argument is not None


def test_an_invalid_target_is_reported_in_the_names_of_the_input() -> None:
    refusal = refusal_of(MoveTo(Waypoint(1.0, nan)))
    assert refusal.text == "y is nan: a finite number is needed"


@pytest.mark.parametrize(
    ("request_", "reason", "figures"),
    [
        (MoveTo(Waypoint(300.0, 400.0)), Reason.OUT_OF_RANGE, (500.0, 100.0)),
        (MoveForward(-101.0), Reason.OUT_OF_RANGE, (-101.0, -100.0)),
        (DriveFor(1.5, 0.0, 1.0), Reason.OUT_OF_RANGE, (1.5, 1.0)),
        (DriveFor(1.0, 0.0, 61.0), Reason.OUT_OF_RANGE, (61.0, 60.0)),
        (DriveFor(1.0, 0.0, -1.0), Reason.OUT_OF_RANGE, (-1.0, 0.0)),
        (SetTravelSpeed(0.0), Reason.OUT_OF_RANGE, (0.0, 0.01)),
        (SetCameraAngles(3.0, None), Reason.OUT_OF_RANGE, (3.0, 2.8)),
        (SetStatusInterval(0.001), Reason.OUT_OF_RANGE, (0.001, 0.05)),
        (FollowPath(()), Reason.EMPTY_PATH, ()),
        (FollowPath((Waypoint(0.0, 0.0),) * 101), Reason.OUT_OF_RANGE, (101.0, 100.0)),
        (TakePicture(format="PNG"), Reason.NOT_SUPPORTED, ()),
        (TakePicture(width_px=8000), Reason.NOT_SUPPORTED, (8000.0, 640.0)),
        (TakePicture(quality=50), Reason.NOT_SUPPORTED, ()),
    ],
    ids=str,
)
def test_a_refusal_carries_the_figure_and_its_bound(
    request_: Request, reason: Reason, figures: tuple[float, ...]
) -> None:
    refusal = refusal_of(request_)
    assert refusal.reason is reason
    assert tuple(figure.value for figure in refusal.figures) == figures


def test_a_path_may_be_longer_than_one_drive_but_no_leg_of_it() -> None:
    steps = tuple(Waypoint(60.0 * k, 0.0) for k in range(1, 5))
    assert poll(FollowPath(steps)) is None
    assert poll(FollowPath((*steps, Waypoint(0.0, 0.0)))) is not None


def test_a_command_with_expired_lifetime_is_refused_with_its_age() -> None:
    refusal = refusal_of(MoveForward(1.0), created_utc_s=990.0, lifetime_s=9.0)
    assert refusal.reason is Reason.EXPIRED
    assert refusal.figures == (Figure("age", 10.0, "s"), Figure("lifetime", 9.0, "s"))
    assert poll(MoveForward(1.0), created_utc_s=990.0, lifetime_s=11.0) is None


def test_a_command_made_too_far_ahead_is_refused_with_both_figures() -> None:
    refusal = refusal_of(MoveForward(1.0), created_utc_s=4600.0, lifetime_s=5.0)
    assert refusal.reason is Reason.CREATED_IN_FUTURE
    assert refusal.figures == (Figure("ahead", 3600.0, "s"), Figure("bound", 10.0, "s"))
    assert poll(MoveForward(1.0), created_utc_s=1009.0, lifetime_s=5.0) is None


def test_motion_needs_odometry_and_queue_capacity() -> None:
    blind = refusal_of(MoveForward(1.0), odometry=False)
    assert blind.reason is Reason.NO_ODOMETRY
    assert blind.text == "no odometry yet: the position of the rover is unknown"
    full = refusal_of(MoveForward(1.0), queued=SETTINGS.drive.queue_length)
    assert full.reason is Reason.QUEUE_FULL
    assert poll(SetCameraAngles(0.1, 0.1), odometry=False) is None


@pytest.mark.parametrize(
    "identity",
    [
        Identity("MOE", 0),
        *(Identity(source, 1) for source in ("", " ", "a\nb", "\x1b[31m", "plan:x")),
    ],
)
def test_an_identity_without_source_is_refused(identity: Identity) -> None:
    refusal = check_identity(Command(identity, RotateTo(0.0), "direct"))
    assert refusal is not None
    assert refusal.reason is Reason.BAD_IDENTIFIER
    assert refusal.text.isprintable()


UNIONS = {
    Motion: {Family.MOTION},
    CameraWork: {Family.CAMERA},
    InstantCommand: {Family.INSTANT},
    Setting: {Family.SETTING, Family.POSE},
    PlanRequest: {Family.PLAN, Family.PLAN_START},
}


def test_the_union_holds_all_declared_commands() -> None:
    assert {each.kind for each in all_declarations()} == set(get_args(Request))


def test_a_family_is_the_union_of_its_queue() -> None:
    for union, families in UNIONS.items():
        kinds = {each.kind for each in all_declarations() if each.family in families}
        assert kinds == set(get_args(union))
    assert set(ACCEPTED) == set(Family)


def test_there_is_a_good_example_of_every_request() -> None:
    assert {type(request) for request in GOOD} == set(get_args(Request))


def test_names_and_operations_are_used_once() -> None:
    for of_each in (lambda each: each.name, lambda each: (each.service, each.operation)):
        found = list(map(of_each, all_declarations()))
        assert len(found) == len(set(found))


def test_a_declared_bound_is_reported_in_a_sentence() -> None:
    for each in all_declarations():
        assert each.summary.endswith("."), each.name
        assert each.examples or each.family in {Family.INSTANT, Family.PLAN, Family.PLAN_START}


def test_every_goal_is_a_leaf_of_plans() -> None:
    goals = {*get_args(Motion), *get_args(CameraWork), *get_args(InstantCommand)}
    assert {declaration_of(kind).name for kind in goals} <= set(LEAVES)


def test_a_request_cannot_be_changed() -> None:
    with pytest.raises(FrozenInstanceError):
        MoveForward(1.0).distance_m = 2.0  # type: ignore[misc]


@pytest.mark.parametrize(
    ("camera", "request_", "text"),
    [
        (
            CameraLimits(),
            TakePicture(),
            "jackal has no camera: its settings have no camera.formats",
        ),
        (CameraLimits(), SetCameraAngles(0.1), "the camera of jackal does not turn"),
        (CameraLimits(formats=("JPG",)), MoveCameraAngles(0.1, 0.0), "does not turn"),
        (CameraLimits(formats=("JPG",)), SetCameraRotateSpeed(0.5), "does not turn"),
    ],
)
def test_commands_to_a_camera_that_the_asset_lacks_are_refused(
    camera: CameraLimits, request_: Request, text: str
) -> None:
    refusal = check_arguments(
        request_, replace(load_settings("jackal"), camera=camera), Point(0.0, 0.0)
    )
    assert refusal is not None
    assert refusal.reason is Reason.NOT_SUPPORTED
    assert text in refusal.text


def test_a_fixed_camera_takes_pictures() -> None:
    fixed = replace(load_settings("jackal"), camera=CameraLimits(formats=("JPG",)))
    assert check_arguments(TakePicture(), fixed, Point(0.0, 0.0)) is None
