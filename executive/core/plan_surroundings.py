"""`RoverSurroundings`: telemetry, checks, faults and questions, as plans see them."""

from collections.abc import Callable, Sequence
from typing import Final

from executive.checks import check_battery, check_pose, check_request
from executive.commands import Mode, MoveTo, Waypoint
from executive.commands.intake import check_arguments, localized
from executive.core.link_loss import GroundMonitor
from executive.goals import Context
from executive.plans import BATTERY_CHARGE, LINK_SILENT_S, LINK_UP, MODE, PlanRoot
from executive.plans import UTC as UTC_NAME
from executive.record import Notifications
from executive.state import picture_of
from executive.values.parameters import Parameter
from executive.values.plan_nodes import Question
from executive.values.reasons import Refusal
from executive.values.reports import Identity, Severity

LINK_UP_S: Final = 10.0
"""Time since the last contact within which the link is up; chosen, not measured."""
MAX_QUESTION_LENGTH: Final = 4096
"""Maximum length in characters of a reported question; the rest is cut."""
BATTERY_S: Final = 10.0
"""Time after a start within which the battery reports its charge; chosen, not measured."""


class RoverSurroundings:
    """The rover and its surroundings, for plans."""

    def __init__(
        self, context: Context, ground: GroundMonitor, notifications: Notifications
    ) -> None:
        self._context = context
        self._notifications = notifications
        self._parameters: dict[str, float | None] = {}
        self._sampled_s = -1.0
        self._began_s = context.clock.now_s()
        self._own: dict[str, Callable[[], float | None]] = {
            LINK_UP: lambda: float(ground.had_contact and ground.silent_s <= LINK_UP_S),
            LINK_SILENT_S: lambda: ground.silent_s,
            MODE: lambda: float(context.mode.value),
            BATTERY_CHARGE: self._charge_ratio,
            UTC_NAME: context.clock.utc_s,
        }

    def telemetry(self, name: str) -> float | None:
        """Return a value of `dialect.TELEMETRY`; None if it is not known."""
        own = self._own.get(name)
        if own is not None:
            return own()
        now_s = self._context.clock.now_s()
        if self._sampled_s != now_s:
            values = self._context.status.values()
            self._parameters = {each.parameter.value: each.value for each in values}
            self._sampled_s = now_s
        return self._parameters[name]

    def _charge_ratio(self) -> float | None:
        fresh = self.telemetry(Parameter.BATERY_VOLTAGE.value) is not None
        battery = self._context.status.battery
        return battery.charge_ratio if fresh and battery is not None else None

    def energy_used_j(self, charge_ratio: float | None) -> float | None:
        """Return the energy used since the battery had a charge; None if it is not known."""
        battery, now_ratio = self._context.settings.battery, self._charge_ratio()
        if battery is None or charge_ratio is None or now_ratio is None:
            return None
        return (charge_ratio - now_ratio) * battery.capacity_j

    def check_target(self, x_m: float, y_m: float) -> Refusal | None:
        """Return why a motion to a point from here would be refused, or None.

        During the search of a detour the motion counts as possible: its own check waits.
        """
        status, settings = self._context.status, self._context.settings
        request = localized(MoveTo(Waypoint(x_m, y_m)), status, settings)
        if isinstance(request, Refusal):
            return request
        pose, obstacles = status.pose, status.obstacles
        return (
            check_arguments(request, settings, pose.point)
            or check_pose(request, pose, status.uncertainty, settings)
            or check_request(request, pose, settings, obstacles, self._context.detours.copy())
        )

    @property
    def awaits_battery(self) -> bool:
        """Whether the battery is still to report its charge after the start."""
        context = self._context
        if context.settings.battery is None or context.status.battery is not None:
            return False
        return context.clock.now_s() < self._began_s + BATTERY_S

    def check_energy(self, plan: PlanRoot, done: Sequence[int]) -> Refusal | None:
        """Return why the battery lacks energy for the other steps and the return, or None.

        Args:
            plan: the plan.
            done: numbers of the steps that have ended.
        """
        status, settings = self._context.status, self._context.settings
        if settings.battery is None:
            return None
        return check_battery(plan, status.pose, status, settings, self._context.scene, done=done)

    def fault_active(self, name: str) -> bool:
        """Return whether a fault is active."""
        return any(each.name == name for each in self._context.safety.active)

    def report_question(self, plan_id: str, question: Question, end: str = "") -> None:
        """Report a question to the operators, with its key, options and deadline; or its end."""
        text = f"plan {plan_id}, question {question.key}: {question.text} "
        if end:
            text = f"{text}{end}"[:MAX_QUESTION_LENGTH]
            self._notifications.report_event(Severity.INFORMATIONAL, text)
            return
        text += f"({' or '.join(question.options)})"
        if question.until_utc_s is not None:
            left_s = question.until_utc_s - self._context.clock.utc_s()
            default = "it fails" if question.default is None else question.default
            text += f"; without an answer within {left_s:.0f} s: {default}"
        self._notifications.report_event(Severity.WARNING, text[:MAX_QUESTION_LENGTH])

    def file_of(self, command: Identity) -> str:
        """Return the path of the picture that a command stored; empty if there is none."""
        return picture_of(self._context.files, command)

    @property
    def position(self) -> tuple[float, float] | None:
        """The position x, y of the rover in m; None without odometry, or if it is uncertain."""
        status = self._context.status
        if not status.odometry_fresh or status.uncertainty:
            return None
        return status.pose.x_m, status.pose.y_m

    @property
    def is_held(self) -> bool:
        """Whether a stop or a fault holds the rover, or another command moves it."""
        latches = self._context.latches
        goals = self._context.goals
        held = latches.hazard is not None or latches.stopped_by is not None
        moves = goals.motion_mode is not Mode.IDLE or goals.motion.blocked_by is not None
        return held or moves or latches.paused is not None
