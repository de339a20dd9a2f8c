"""How motion goals become commands of the actuators."""

from executive.motion.arbiter import Arbiter, Intents, Latches, make_locomotion
from executive.motion.locomotion import Leg, Locomotion, Motion, Step, leg_errors, plan_leg
from executive.motion.velocity_control import VelocityLocomotion

__all__ = [
    "Arbiter",
    "Intents",
    "Latches",
    "Leg",
    "Locomotion",
    "Motion",
    "Step",
    "VelocityLocomotion",
    "leg_errors",
    "make_locomotion",
    "plan_leg",
]
