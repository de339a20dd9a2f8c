"""How motion goals become commands of the actuators."""

from executive.motion.arbiter import Arbiter, Intents, Latches, make_locomotion
from executive.motion.locomotion import Leg, Locomotion, Motion, Step, leg_errors, plan_leg
from executive.motion.velocity_control import VelocityLocomotion
from executive.motion.verification import (
    FUSED_NEAR_M,
    SEEN_BEFORE,
    TURN_NEAR_M,
    WAIT_S,
    Verification,
    Verified,
)

__all__ = [
    "FUSED_NEAR_M",
    "SEEN_BEFORE",
    "TURN_NEAR_M",
    "WAIT_S",
    "Arbiter",
    "Intents",
    "Latches",
    "Leg",
    "Locomotion",
    "Motion",
    "Step",
    "VelocityLocomotion",
    "Verification",
    "Verified",
    "leg_errors",
    "make_locomotion",
    "plan_leg",
]
