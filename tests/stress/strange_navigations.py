"""Navigations that lie in other ways than those of `Navigation`; and one that acts at random."""

from collections.abc import Sequence
from math import cos, inf, nan, pi, sin

from executive.values.geometry import STANDING, Pose, Velocity
from tests.support.navigation import (
    GoalEnd,
    GoalFeedback,
    GoalResult,
    Navigation,
    RunningGoal,
    beside,
)

ENDS = tuple(GoalEnd)


class StrangeNavigation(Navigation):
    """Behaviours that were thought of later, and those of `Navigation`."""

    _ended: tuple[RunningGoal, float] | None = None
    _earlier: object = None
    _refused = 0

    @classmethod
    def strange(cls) -> list[str]:
        """Return the names of the behaviours that only this class has."""
        return sorted(set(cls.behaviours()) - set(Navigation.behaviours()))

    def submit(self, key: object, poses: Sequence[Pose], now_s: float) -> bool | None:
        self._earlier, self._ended = self.goal.key if self.goal else self._earlier, None
        match self.behaviour:
            case "result_before_acceptance":
                self.events.append(GoalResult(key, GoalEnd.SUCCEEDED))
                return super().submit(key, poses, now_s)
            case "rejects_once" if self._refused < 1:
                self._refused += 1
                return False
            case _:
                return super().submit(key, poses, now_s)

    def step(self, now_s: float, pose: Pose) -> Velocity | None:
        velocity = super().step(now_s, pose)
        if self.goal is None and self._ended is not None:
            velocity = self._after_end(*self._ended, now_s) or velocity
        if self.behaviour == "publishes_zeros" and velocity is None:
            return STANDING
        return velocity

    def _succeed(self, goal: RunningGoal, now_s: float) -> None:
        self._end(GoalEnd.SUCCEEDED)
        self._ended = goal, now_s

    def _after_end(self, goal: RunningGoal, ended_s: float, now_s: float) -> Velocity | None:
        since_s = now_s - ended_s
        match self.behaviour:
            case "succeeds_twice" if 0.5 <= since_s < 0.55 or 2.0 <= since_s < 2.05:
                self.events.append(GoalResult(goal.key, GoalEnd.SUCCEEDED))
            case "succeeds_then_aborts" if 0.1 <= since_s < 0.15:
                self.events.append(GoalResult(goal.key, GoalEnd.ABORTED, 105))
            case "feeds_after_the_result" if since_s < 6.0:
                self._feed(goal, now_s, 3.0)
            case "pauses_at_success" if since_s < 3.0:
                return STANDING if since_s < 0.35 else Velocity(0.3, 0.0)
            case "creeps_after_success" if since_s < 6.0:
                return Velocity(0.02, 0.0)
            case "twitches_after_success" if since_s < 8.0:
                # Never longer than the smoother's time.
                return Velocity(0.4, 0.0) if since_s % 1.5 < 0.7 else None
            case _:
                pass
        return None

    def _honest_then(self, goal: RunningGoal, now_s: float, pose: Pose) -> Velocity | None:
        self._feed(goal, now_s, self._remaining_m(goal, pose))
        velocity = self._follow(goal, pose)
        if velocity is None:
            self._succeed(goal, now_s)
        return self._give(velocity or STANDING)

    def _do_succeeds_twice(self, goal: RunningGoal, now_s: float, pose: Pose) -> Velocity | None:
        """Reports its success three times."""
        return self._honest_then(goal, now_s, pose)

    def _do_succeeds_then_aborts(
        self, goal: RunningGoal, now_s: float, pose: Pose
    ) -> Velocity | None:
        """Reports success, and 0.1 s later that it aborted."""
        return self._honest_then(goal, now_s, pose)

    def _do_feeds_after_the_result(
        self, goal: RunningGoal, now_s: float, pose: Pose
    ) -> Velocity | None:
        """Sends feedback for six seconds after its success."""
        return self._honest_then(goal, now_s, pose)

    def _do_pauses_at_success(self, goal: RunningGoal, now_s: float, pose: Pose) -> Velocity | None:
        """Stands for a third of a second at its success, then drives on."""
        return self._honest_then(goal, now_s, pose)

    def _do_creeps_after_success(
        self, goal: RunningGoal, now_s: float, pose: Pose
    ) -> Velocity | None:
        """Creeps after its success, slower than what counts as motion."""
        return self._honest_then(goal, now_s, pose)

    def _do_twitches_after_success(
        self, goal: RunningGoal, now_s: float, pose: Pose
    ) -> Velocity | None:
        """Drives on after its success in short spells."""
        return self._honest_then(goal, now_s, pose)

    def _do_publishes_zeros(self, goal: RunningGoal, now_s: float, pose: Pose) -> Velocity | None:
        """Publishes zero velocities for ever, also without a goal."""
        return self._do_honest(goal, now_s, pose)

    def _do_result_before_acceptance(
        self, goal: RunningGoal, now_s: float, pose: Pose
    ) -> Velocity | None:
        """Reports success before it has accepted the goal, then drives there."""
        return self._do_honest(goal, now_s, pose)

    def _do_rejects_once(self, goal: RunningGoal, now_s: float, pose: Pose) -> Velocity | None:
        """Rejects the first goal, and is honest with the next."""
        return self._do_honest(goal, now_s, pose)

    def _do_reports_an_earlier_goal(
        self, goal: RunningGoal, now_s: float, pose: Pose
    ) -> Velocity | None:
        """Reports success of the goal before this one as soon as this one begins."""
        if self._earlier not in (None, goal.key):
            self.events.append(GoalResult(self._earlier, GoalEnd.SUCCEEDED))
            self._earlier = None
        velocity = self._do_honest(goal, now_s, pose)
        if self.goal is None:
            self._earlier = goal.key
        return velocity

    def _do_oscillates(self, goal: RunningGoal, now_s: float, pose: Pose) -> Velocity | None:
        """Drives to and fro with honest feedback, and never arrives."""
        self._feed(goal, now_s, self._remaining_m(goal, pose))
        forward = (now_s - goal.accepted_s) % 8.0 < 4.0
        return self._give(Velocity(0.4 if forward else -0.4, 0.0))

    def _do_drives_away(self, goal: RunningGoal, now_s: float, pose: Pose) -> Velocity | None:
        """Turns away from the target and drives, with feedback as if it came nearer."""
        since_s = now_s - goal.accepted_s
        self._feed(goal, now_s, max(0.0, 8.0 - 0.3 * since_s))
        return self._give(Velocity(0.3, 0.05))

    def _do_drives_away_and_succeeds(
        self, goal: RunningGoal, now_s: float, pose: Pose
    ) -> Velocity | None:
        """Drives anywhere for ten seconds, and succeeds while it drives."""
        since_s = now_s - goal.accepted_s
        self._feed(goal, now_s, max(0.0, 3.0 - 0.3 * since_s))
        if since_s > 10.0:
            self._succeed(goal, now_s)
        return self._give(Velocity(0.5, 0.1))

    def _do_succeeds_off_and_turned(
        self, goal: RunningGoal, now_s: float, pose: Pose
    ) -> Velocity | None:
        """Succeeds 0.4 m beside the target, with another heading."""
        if "moved" not in goal.marks:
            goal.marks["moved"] = 1.0
            direction_rad, target = self.random.uniform(-pi, pi), goal.poses[-1]
            moved = beside(target, 0.3 * cos(direction_rad), 0.3 * sin(direction_rad))
            goal.poses[-1] = Pose(moved.x_m, moved.y_m, heading_rad=target.heading_rad + 2.0)
        return self._do_honest(goal, now_s, pose)

    def _do_gives_nan(self, goal: RunningGoal, now_s: float, pose: Pose) -> Velocity | None:
        """Publishes velocities that are not numbers, half of the time."""
        velocity = self._do_honest(goal, now_s, pose)
        broken = self.goal is not None and now_s % 1.0 < 0.5
        return Velocity(nan, nan) if broken else velocity

    def _do_races(self, goal: RunningGoal, now_s: float, pose: Pose) -> Velocity | None:
        """Publishes 5 m/s."""
        velocity = self._do_honest(goal, now_s, pose)
        return velocity and Velocity(5.0 if velocity.travel_mps else 0.0, velocity.rotate_radps)

    def _do_nearly_silent(self, goal: RunningGoal, now_s: float, pose: Pose) -> Velocity | None:
        """Is silent for just less than the limits: 0.8 s in motion, 2.7 s while it stands."""
        phase_s = (now_s - goal.accepted_s) % 5.0
        moves = phase_s < 2.0
        if (moves and phase_s % 0.8 < 0.05) or (not moves and 2.0 <= phase_s < 2.05):
            self._feed(goal, now_s, self._remaining_m(goal, pose))
        if not moves:
            return self._give(STANDING) if phase_s < 2.3 else None
        velocity = self._follow(goal, pose)
        if velocity is None:
            self._end(GoalEnd.SUCCEEDED)
        return self._give(velocity or STANDING)

    def _do_cancels_itself(self, goal: RunningGoal, now_s: float, pose: Pose) -> Velocity | None:
        """Ends as cancelled halfway, though nothing was cancelled."""
        if self._is_halfway(goal, pose):
            self._end(GoalEnd.CANCELLED)
            return self._give(STANDING)
        return self._do_honest(goal, now_s, pose)

    def _do_passes_wide(self, goal: RunningGoal, now_s: float, pose: Pose) -> Velocity | None:
        """Passes poses on the way at a metre, and is honest at the last."""
        if goal.index + 1 < len(goal.poses) and "wide" not in goal.marks:
            goal.marks["wide"] = 1.0
            goal.poses[:-1] = [beside(each, 0.8, 0.8) for each in goal.poses[:-1]]
        return self._do_honest(goal, now_s, pose)

    def _do_skips_poses(self, goal: RunningGoal, now_s: float, pose: Pose) -> Velocity | None:
        """Drives to the last pose alone, and succeeds."""
        goal.index = len(goal.poses) - 1
        return self._do_honest(goal, now_s, pose)

    def _do_feeds_nonsense(self, goal: RunningGoal, now_s: float, pose: Pose) -> Velocity | None:
        """Gives NaN, infinite and negative distances as feedback."""
        if now_s - goal.feedback_sent_s >= 0.1 - 1e-6:
            goal.feedback_sent_s = now_s
            nonsense = self.random.choice((nan, inf, -1.0, 1e30))
            self.events.append(GoalFeedback(goal.key, nonsense, -5, -1))
        velocity = self._follow(goal, pose)
        if velocity is None:
            self._end(GoalEnd.SUCCEEDED)
        return self._give(velocity or STANDING)

    def _do_loses_the_result(self, goal: RunningGoal, now_s: float, pose: Pose) -> Velocity | None:
        """Drives there, ends the goal, and its result is lost."""
        self._feed(goal, now_s, self._remaining_m(goal, pose))
        velocity = self._follow(goal, pose)
        if velocity is None:
            self.goal = None
        return self._give(velocity or STANDING)

    def _do_spins_at_the_target(
        self, goal: RunningGoal, now_s: float, pose: Pose
    ) -> Velocity | None:
        """Drives there, and turns on the spot for ever."""
        self._feed(goal, now_s, self._remaining_m(goal, pose))
        return self._give(self._follow(goal, pose) or Velocity(0.0, 0.7))

    def _do_backs_off_at_the_target(
        self, goal: RunningGoal, now_s: float, pose: Pose
    ) -> Velocity | None:
        """Stands at the target for a second, backs up two metres to recover, then drives there."""
        self._feed(goal, now_s, self._remaining_m(goal, pose))
        velocity = self._follow(goal, pose)
        if velocity is not None and "there_s" not in goal.marks:
            return self._give(velocity)
        since_s = now_s - goal.marks.setdefault("there_s", now_s)
        if since_s < 1.0:
            return self._give(STANDING)
        if since_s < 6.0:
            goal.recoveries, goal.at_position = 1, False
            return self._give(Velocity(-0.3, 0.0))
        if velocity is None:
            self._end(GoalEnd.SUCCEEDED)
        return self._give(velocity or STANDING)


class RandomNavigation(Navigation):
    """Acts at random: answers, feedback, results and velocities in any order."""

    _keys: tuple[object, ...] = ()
    _mood = "honest"
    _until_s = -inf
    _any = STANDING

    def submit(self, key: object, poses: Sequence[Pose], now_s: float) -> bool | None:
        self._keys = (*self._keys, key)[-3:]
        if self.random.random() < 0.1:
            return self.random.choice((None, False))
        return super().submit(key, poses, now_s)

    def cancel(self, key: object | None = None) -> list[object]:
        return super().cancel(key) if self.random.random() < 0.7 else []

    def step(self, now_s: float, pose: Pose) -> Velocity | None:
        random = self.random
        if now_s >= self._until_s:
            self._until_s = now_s + random.expovariate(0.5)
            moods = ("honest", "honest", "honest", "any", "silent", "zero", "repeat", "still")
            self._mood = random.choice(moods)
            self._any = Velocity(random.uniform(-0.6, 0.6), random.uniform(-1, 1))
        if self._keys and random.random() < 0.004:
            end, key = random.choice(ENDS), random.choice(self._keys)
            self.events.append(GoalResult(key, end, random.choice((0, 105, 208))))
            if random.random() < 0.5:
                self.goal = None
        if self._keys and random.random() < 0.02:
            feedback = GoalFeedback(random.choice(self._keys), random.uniform(0, 9), 0, 1)
            self.events.append(feedback)
        honest = super().step(now_s, pose)
        match self._mood:
            case "any":
                return self._give(self._any)
            case "silent":
                return None
            case "zero":
                return STANDING
            case "repeat":
                return self._last
            case _:
                return honest
