"""How motion goals become commands of the actuators."""

from executive.motion.arbiter import Arbiter, Intents, Latches, make_locomotion
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
from executive.motion.plan import Plan, PlanSolver, Problem
from executive.motion.predictive_control import make_solver
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
    "Locomotion",
    "MinimumTime",
    "Motion",
    "Plan",
    "PlanSolver",
    "Problem",
    "Step",
    "VelocityLocomotion",
    "Verification",
    "Verified",
    "duration_s",
    "leg_errors",
    "make_locomotion",
    "make_solver",
    "plan_leg",
]
