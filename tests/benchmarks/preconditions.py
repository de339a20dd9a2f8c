"""Relative commands behind a delay that loses some of them, with and without preconditions.

Plays the random sites of `delayed_sites` at a round trip of 10 s, with 15 % of the commands lost.
The operator without preconditions and the one with them do the same: as soon as a command is known
to be lost or refused, they send nothing until all others have ended, and plan again from the next
picture of the standing rover. A third one uses that with preconditions the rover is then at a
planned pose: it sends the rest of the path again at once, from the lost command on.
"""

import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path
from typing import Final

from adapters.twin.twin import REPORT_MARGIN_S
from executive.commands import OnlyAt, Precondition, Request, RotateBy
from executive.values.geometry import Pose
from executive.values.reasons import Reason
from executive.values.reports import Identity, Stage
from tests.benchmarks.delayed_sites import LENGTH_M, Mission, Played
from tests.support.figures import Figure, Goal

ROUND_TRIP_S: Final = 10.0
LOSS: Final = 0.15
WITHIN_M, WITHIN_RAD = 0.5, 0.2
"""Bounds of the pose, as in the console."""
MIN_TURN_RAD: Final = 0.02
REFUSED: Final = {Reason.PRECONDITION_POSE, Reason.PRECONDITION_COMMAND}


@dataclass(frozen=True, slots=True)
class Leg:
    """A motion of the plan, and its planned start pose."""

    request: Request
    begin: Pose


class Unconditional(Mission):
    """An operator of relative commands, who sends no turn below the tolerance of a turn."""

    def _send_motion(self, request: Request, begin: Pose) -> None:
        if not isinstance(request, RotateBy) or abs(request.angle_rad) > MIN_TURN_RAD:
            self._motions[self._send_leg(request, begin)] = self.link.utc_s

    def _send_leg(self, request: Request, begin: Pose) -> Identity:
        return self.link.send(request)

    def _follow_up(self) -> None:
        for identity in self._motions:
            if self._is_lost(identity):
                self._motions[identity] = -inf  # it is overdue
        super()._follow_up()

    def _is_lost(self, identity: Identity) -> bool:
        """Whether a command is without a report when it is due, or one after it has a report."""
        late_s = self._motions[identity] + ROUND_TRIP_S + REPORT_MARGIN_S
        later = [each for each in self._motions if each.command_id > identity.command_id]
        overdue = self.link.utc_s > late_s or any(map(self.link.stages, later))
        return overdue and not self.link.stages(identity)


class Conditional(Unconditional):
    """The same operator, whose commands need their planned start pose and the one before them."""

    _legs: dict[Identity, Leg]
    _last: Identity | None

    def _send_leg(self, request: Request, begin: Pose) -> Identity:
        if not self._motions:
            self._legs, self._last = {}, None
        at = OnlyAt(begin.x_m, begin.y_m, WITHIN_M, begin.heading_rad, WITHIN_RAD)
        after = None if self._last is None else self._last.command_id
        self._last = self.link.send(request, precondition=Precondition(at, after))
        self._legs[self._last] = Leg(request, begin)
        return self._last


class Resending(Conditional):
    """An operator who sends the rest of a broken chain again."""

    def _follow_up(self) -> None:
        ended = (each for each in self._motions if self._is_broken(each) or self._has_ended(each))
        broken = next(ended, None)
        if broken is None or not self._is_broken(broken):
            super()._follow_up()
            return
        sent = list(self._motions)
        before, rest = sent[: sent.index(broken)], sent[sent.index(broken) :]
        legs = [self._legs[each] for each in rest]
        self._last = before[-1] if before else self._executed_before(broken)
        for identity in rest[1:]:
            del self._motions[identity]
        for leg in legs:  # the broken one is still there: the chain continues
            self._send_motion(leg.request, leg.begin)
        del self._motions[broken]
        self.played.refused += len(rest)

    def _has_ended(self, identity: Identity) -> bool:
        stages = self.link.stages(identity)
        return bool(stages) and stages[-1].terminal

    def _executed_before(self, broken: Identity) -> Identity | None:
        """Return the command that a broken one was to follow."""
        command = next(each for each, _ in self.link.sent if each.identity == broken)
        after = command.precondition.after if command.precondition else None
        return None if after is None else replace(broken, command_id=after)

    def _is_broken(self, identity: Identity) -> bool:
        """Whether a command is known to be lost, or was refused by its precondition."""
        reports = [each for each in self.link.received if each.identity == identity]
        if reports:
            return reports[-1].stage is Stage.REJECTED and reports[-1].reason in REFUSED
        return self._is_lost(identity)


def measure(sites: int, log: Callable[[str], None]) -> list[Figure]:
    """Return contacts and pace over the first sites, with preconditions and without."""
    kinds = (Unconditional, Conditional, Resending)
    played: dict[type[Mission], list[Played]] = {kind: [] for kind in kinds}
    for number in range(1, sites + 1):
        for kind, missions in played.items():
            missions.append(play(number, kind))
            found = missions[-1]
            text = f"{found.lost} commands lost, {found.refused} sent again"
            duration_s = "no goal" if found.duration_s is None else f"{found.duration_s:.0f} s"
            log(f"site {number}, {kind.__name__}: {duration_s}, {found.contacts} contacts, {text}")
    without, *conditional = played.values()
    figures = [
        Figure("without: contacts", sum(each.contacts for each in without), ""),
        Figure("without: sites with contacts", sum(each.contacts > 0 for each in without), ""),
    ]
    names = "with preconditions", "with preconditions, resending"
    for name, missions in zip(names, conditional, strict=True):
        figures += _compared(name, without, missions)
    return figures


def _compared(name: str, without: list[Played], missions: list[Played]) -> list[Figure]:
    """Return the contacts of missions, and their pace where both operators reach the goal."""
    both = [
        (one.duration_s, other.duration_s)
        for one, other in zip(without, missions, strict=True)
        if one.duration_s is not None and other.duration_s is not None
    ]
    paces = [LENGTH_M * 3600.0 * len(both) / sum(each) for each in zip(*both, strict=True)]
    contacts, sites = sum(each.contacts for each in missions), len(missions)
    goal, reached = Goal(0.95, at_least=True), sum(each.duration_s is not None for each in missions)
    return [
        Figure(f"{name}: contacts", contacts, "", goal=Goal(0.0)),
        Figure(f"{name}: pace", paces[1], "m/h", f"{paces[0]:.0f} without, {len(both)} sites"),
        Figure(f"{name}: pace, of that without", paces[1] / paces[0], "ratio", goal=goal),
        Figure(f"{name}: sites crossed", reached, "", goal=Goal(sites, at_least=True)),
    ]


def play(number: int, kind: type[Mission]) -> Played:
    """Play a site with relative commands; the twin predicts nothing."""
    with tempfile.TemporaryDirectory() as folder:
        mission = kind(number, Path(folder), ROUND_TRIP_S, relative=True, loss=LOSS, stuck=False)
        mission._next_prediction_s = 1e9
        return mission.play()
