"""How motion goals become commands of the actuators.

    leaf ──> plan_leg ──> Leg ──> Locomotion.turn / line / hold ──> Motion
                                                                      │ want, each tick
    rover <── Mover <── arbiter (stop latch, dead-man) <── intents <──+

`Locomotion.expected` says what the rover should be doing now, with which `executive.safety`
compares it.

With `controller: mpc`, `predictive_control` is the control law. `minimum_time` solves its problems
(`plan`) as a non-linear `programme`, from the first guesses of `polylines`; `motion_model` and
`motion_observer` say how the rover answers and moves, and `obstacles` which rows of the programme
keep each place of a plan away from rocks and zones.
"""

from executive.motion.arbiter import Arbiter, Intents, Latches, make_locomotion
from executive.motion.delegated_motion import MotionProfile, profile_of
from executive.motion.leg_progress import LegProgress
from executive.motion.locomotion import (
    Bounds,
    Leg,
    Locomotion,
    Motion,
    Step,
    duration_s,
    leg_errors,
    plan_leg,
)
from executive.motion.minimum_time import MinimumTime
from executive.motion.motion_model import MotionState
from executive.motion.plan import Plan, PlanSolver, Problem, SharedSolver, Target
from executive.motion.predictive_control import make_solver, model_of
from executive.motion.route import passes_by
from executive.motion.velocity_control import VelocityLocomotion
from executive.motion.verification import (
    FUSED_NEAR_M,
    TURN_NEAR_M,
    WAIT_S,
    Verification,
    Verified,
)

__all__ = [
    "FUSED_NEAR_M",
    "TURN_NEAR_M",
    "WAIT_S",
    "Arbiter",
    "Bounds",
    "Intents",
    "Latches",
    "Leg",
    "LegProgress",
    "Locomotion",
    "MinimumTime",
    "Motion",
    "MotionProfile",
    "MotionState",
    "Plan",
    "PlanSolver",
    "Problem",
    "SharedSolver",
    "Step",
    "Target",
    "VelocityLocomotion",
    "Verification",
    "Verified",
    "duration_s",
    "leg_errors",
    "make_locomotion",
    "make_solver",
    "model_of",
    "passes_by",
    "plan_leg",
    "profile_of",
]
