"""Turns motion goals into actuator commands.

    leaf ──> plan_leg ──> Leg ──> Locomotion.make_turn / line / hold ──> Motion
                                                                      │ intent, each tick
    rover <── BaseDriver <── arbiter (latch, dead-man) <── intents <──+

`BaseDriver.expected` gives the velocity that the rover should have now. `executive.safety` compares
the rover with it.

With `controller: mpc`, `predictive_control` is the control law. `minimum_time` solves its problems
(`trajectory`) as non-linear programmes (`optimal_control`), from initial guesses. `motion_model`
models the rover and estimates its state. `obstacle_constraints` hold each point
of a trajectory off rocks and zones.
"""

from executive.motion.arbiter import Arbiter as Arbiter
from executive.motion.arbiter import Intents as Intents
from executive.motion.arbiter import Latches as Latches
from executive.motion.arbiter import make_locomotion as make_locomotion
from executive.motion.delegated_motion import profile_of as profile_of
from executive.motion.locomotion import Bounds as Bounds
from executive.motion.locomotion import Leg as Leg
from executive.motion.locomotion import Locomotion as Locomotion
from executive.motion.locomotion import Motion as Motion
from executive.motion.locomotion import Step as Step
from executive.motion.locomotion import duration_s as duration_s
from executive.motion.locomotion import leg_errors as leg_errors
from executive.motion.locomotion import plan_leg as plan_leg
from executive.motion.minimum_time import MinimumTimeSolver as MinimumTimeSolver
from executive.motion.motion_model import MotionState as MotionState
from executive.motion.navigation import NavigatedMotion as NavigatedMotion
from executive.motion.navigation import navigate_to as navigate_to
from executive.motion.predictive_control import make_solver as make_solver
from executive.motion.predictive_control import model_of as model_of
from executive.motion.relative_actions import act_relatively as act_relatively
from executive.motion.relative_actions import finish_relative as finish_relative
from executive.motion.route import passes_within as passes_within
from executive.motion.trajectory import SharedSolver as SharedSolver
from executive.motion.trajectory import Trajectory as Trajectory
from executive.motion.trajectory import TrajectoryProblem as TrajectoryProblem
from executive.motion.trajectory import TrajectorySolver as TrajectorySolver
from executive.motion.trajectory import TrajectoryTarget as TrajectoryTarget
from executive.motion.velocity_control import VelocityLocomotion as VelocityLocomotion
from executive.motion.velocity_control import hold_extent as hold_extent
from executive.motion.verification import FUSED_TOLERANCE_M as FUSED_TOLERANCE_M
from executive.motion.verification import TURN_TOLERANCE_M as TURN_TOLERANCE_M
from executive.motion.verification import WAIT_S as WAIT_S
from executive.motion.verification import MotionVerification as MotionVerification
from executive.motion.verification import Verified as Verified
