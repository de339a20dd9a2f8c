"""Leaves for the camera: `PanTilt` points it, `Capture` takes and stores a picture."""

from py_trees.common import Status

from executive.commands import MoveCameraAngles, SetCameraAngles
from executive.goals import Context, Goal, GoalQueue
from executive.state import store_picture
from executive.values.facts import CameraAngles, Source, frame_fault
from executive.values.ports import CameraIntent
from executive.values.quantities import angle_text
from executive.values.reasons import Figure, Reason, Refusal
from trees.leaf import GoalLeaf

MARGIN_S = 3.0


class PanTilt(GoalLeaf):
    """Points the camera and waits until it has arrived.

    Angles are computed once per goal, so that a relative one is not added again when the leaf
    continues after a hazard. Without a measurement there is no angle to add to or to hold.
    """

    timeout_reason = Reason.PAN_TILT_DEADLINE
    timeout_text = "the camera did not reach its angles"

    def __init__(self, name: str, context: Context, queue: GoalQueue) -> None:
        super().__init__(name, context, queue)
        self._aimed_for: Goal | None = None
        self._target = CameraAngles(0.0, 0.0)

    def begin(self) -> float:
        """Allow time for the first measured angles."""
        self._speed_radps = 0.0
        return MARGIN_S

    def act(self) -> Status:
        """Request the angles until they are measured."""
        measured = self.context.status.camera
        if measured is None:
            return Status.RUNNING
        if self._aimed_for is not self.goal:
            self._aimed_for = self.goal
            self._target = self._aim(measured)
        self._request(self._target, self.goal)
        left_rad = max(
            abs(self._target.pan_rad - measured.pan_rad),
            abs(self._target.tilt_rad - measured.tilt_rad),
        )
        self._allow(left_rad)
        self.feedback_message = f"{angle_text(left_rad)} remaining"
        if left_rad > self.context.settings.camera.angle_tolerance_rad:
            return Status.RUNNING
        self.queue.complete_active(
            "camera pointed",
            (Figure("pan", measured.pan_rad, "rad"), Figure("tilt", measured.tilt_rad, "rad")),
        )
        return Status.SUCCESS

    def terminate(self, new_status: Status) -> None:
        """Hold the camera at its present angles if its goal ended before they were reached.

        No other leaf sets a camera intent, so this overwrites none.
        """
        if self._aimed_for is None or self._aimed_for is self.queue.active:
            return
        self._aimed_for = None
        measured = self.context.status.camera
        if new_status is not Status.SUCCESS and measured is not None:
            self._request(measured, None)

    def _request(self, angles: CameraAngles, goal: Goal | None) -> None:
        self.context.intents.camera = CameraIntent(
            angles.pan_rad,
            angles.tilt_rad,
            self.context.status.camera_speed_radps,
            None if goal is None else goal.command.identity,
        )

    def _aim(self, present: CameraAngles) -> CameraAngles:
        """Return the target angles, within the limits of the mast."""
        request = self.goal.command.request
        limits = self.context.settings.camera
        match request:
            case SetCameraAngles(pan_rad, tilt_rad):
                pan = present.pan_rad if pan_rad is None else pan_rad
                tilt = present.tilt_rad if tilt_rad is None else tilt_rad
            case MoveCameraAngles(pan_rad, tilt_rad):
                pan, tilt = present.pan_rad + pan_rad, present.tilt_rad + tilt_rad
            case _:
                raise TypeError(f"{request} points no camera")
        return CameraAngles(
            max(limits.pan_min_rad, min(limits.pan_max_rad, pan)),
            max(limits.tilt_min_rad, min(limits.tilt_max_rad, tilt)),
        )

    def _allow(self, left_rad: float) -> None:
        """Set the deadline by the camera's speed; again if it changes, or while motion blocks."""
        speed_radps = self.context.status.camera_speed_radps
        waits = (
            self.context.locomotion.excludes_camera and self.context.goals.motion.active is not None
        )
        if waits or speed_radps != self._speed_radps:
            self._speed_radps = speed_radps
            self.set_deadline(2.0 * left_rad / speed_radps + MARGIN_S)


class Capture(GoalLeaf):
    """Stores the first complete camera frame that was taken after its request."""

    timeout_reason = Reason.CAPTURE_DEADLINE
    timeout_text = "no camera frame received"
    needs = Source.CAMERA

    def __init__(self, name: str, context: Context, queue: GoalQueue) -> None:
        super().__init__(name, context, queue)
        self._last_stamp_s: float | None = None

    def begin(self) -> float:
        """Request a frame."""
        self._requested_s = self.context.clock.now_s()
        self._frame_fault: Refusal | None = None
        self._request_frame()
        return self.context.settings.camera.capture_deadline_s

    def act(self) -> Status:
        """Wait for the frame and store it; request another if it is invalid or outdated."""
        frame = self.context.status.frame
        if frame is None or self.context.status.frames == self._seen:
            self.feedback_message = "waiting for a frame"
            return Status.RUNNING
        taken_s = self.context.safety.history.frame_time_s
        self._frame_fault = frame_fault(frame, taken_s, self._requested_s, self._last_stamp_s)
        if self._frame_fault is not None:
            self.feedback_message = self._frame_fault.text
            self._request_frame()
            return Status.RUNNING
        self._last_stamp_s = frame.stamp_s
        try:
            context, identity = self.context, self.goal.command.identity
            path = store_picture(context.files, frame, identity, context.status.values())
        except OSError as error:
            return self.fail(
                Refusal(Reason.CAPTURE_NOT_STORED, f"the picture could not be stored: {error}")
            )
        self.queue.complete_active(
            f"picture {path} stored", (Figure("size", len(frame.data), "octet"),)
        )
        return Status.SUCCESS

    def on_timeout(self) -> Status:
        """Fail the goal, with the fault of the last frame."""
        return super().on_timeout() if self._frame_fault is None else self.fail(self._frame_fault)

    def _request_frame(self) -> None:
        self._seen = self.context.status.frames
        self.context.intents.frame = True
