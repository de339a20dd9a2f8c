"""What waited for contact: as the lanes of a timeline, and as figures."""

from collections.abc import Iterator, Sequence
from itertools import pairwise

from adapters.mrs.spec import Stage
from sim.demo.life import Life, Told
from sim.demo.mission import Played
from sim.demo.script import Link
from sim.demo.session import Session
from sim.demo.timeline import SHORT_S, Lane, Level, Passage, Rover, Timeline
from sim.processes.relay import Orbiter


def timeline_of(played: Sequence[Played], orbiter: Orbiter) -> Timeline:
    """Return the timeline of sessions that were played at the same time."""
    sessions = [each.session for each in played]
    start_utc_s = min(session.lives[0].sent_utc_s for session in sessions)
    ends = [told.utc_s for session in sessions for told in _told(session)]
    several = len(played) > 1
    rovers = tuple(
        Rover(
            each.role.script.title if several else "",
            tuple(lane_of(life, start_utc_s) for life in each.session.lives),
        )
        for each in played
    )
    since_s = orbiter.start_utc_s - start_utc_s
    eclipses = tuple(
        (since_s + eclipse.begin_s, since_s + eclipse.end_s) for eclipse in orbiter.eclipses
    )
    title = f"Commands to {' and '.join(each.role.script.title for each in played)}"
    return Timeline(
        title=f"{title} through an eclipse" if eclipses else f"{title}, by two links",
        rovers=rovers,
        eclipses=eclipses,
        commands=_queue(sessions[0], start_utc_s),
        reports=_aboard(sessions[0], start_utc_s),
        end_s=max(ends) - start_utc_s,
    )


def waited(session: Session) -> Iterator[tuple[str, str]]:
    """Yield figures of what waited: a name, and what is to be said of it."""
    stored_s = [
        left_utc_s - life.sent_utc_s
        for life in session.lives
        if (left_utc_s := _left_utc_s(life)) is not None
    ]
    told_s = [told.utc_s - told.aboard_utc_s for told in session.reports[Link.RELAY]]
    for name, waits_s in (
        ("commands that waited at the orbiter", stored_s),
        ("reports that waited aboard", told_s),
    ):
        long_s = [wait_s for wait_s in waits_s if wait_s > SHORT_S]
        figure = f"{len(long_s)} of {len(waits_s)}"
        yield name, figure + (f", the longest for {max(long_s):.1f} s" if long_s else "")


def _left_utc_s(life: Life) -> float | None:
    """Return when a command left the orbiter, for the rover or because it was given up."""
    if not life.stored:
        return None
    if life.lost is not None:
        return life.lost.utc_s
    received = life.reached(Stage.RECEIVED)
    return None if received is None else received.aboard_utc_s


def _told(session: Session) -> Iterator[Told]:
    for life in session.lives:
        yield from life.told


def lane_of(life: Life, start_utc_s: float) -> Lane:
    """Return the lane of a life; times since a start."""

    def passage(told: Told | None) -> Passage | None:
        if told is None:
            return None
        made_utc_s = max(told.aboard_utc_s, life.sent_utc_s)  # a repeat is told what was before
        return Passage(made_utc_s - start_utc_s, told.utc_s - start_utc_s)

    taken_utc_s = life.taken_utc_s if life.stored else None
    return Lane(
        title=life.spelled,
        link=life.step.link,
        ending=life.ending,
        sent_s=life.sent_utc_s - start_utc_s,
        stored_s=None if taken_utc_s is None else taken_utc_s - start_utc_s,
        received=passage(life.reached(Stage.RECEIVED)),
        started=passage(life.reached(Stage.STARTED)),
        ended=None if life.lost else passage(life.ended),
        lost_s=life.lost.utc_s - start_utc_s if life.lost else None,
        again=life.step.repeats,
    )


def _queue(session: Session, start_utc_s: float) -> tuple[Level, ...]:
    """Return how many bundles waited at the orbiter, where that changed."""
    seen = [Level(sky.utc_s - start_utc_s, int(sky.sky.queued)) for sky in session.skies]
    return tuple(later for earlier, later in pairwise(seen) if later.waiting != earlier.waiting)


def _aboard(session: Session, start_utc_s: float) -> tuple[Level, ...]:
    """Return how many reports waited aboard, where that changed."""
    changes: list[tuple[float, int]] = []
    for told in session.reports[Link.RELAY]:
        if told.notification.sequence and told.utc_s - told.aboard_utc_s > SHORT_S:
            changes += [(told.aboard_utc_s, 1), (told.utc_s, -1)]
    levels: list[Level] = []
    waiting = 0
    for at_utc_s, change in sorted(changes):
        waiting += change
        levels.append(Level(at_utc_s - start_utc_s, waiting))
    return tuple(levels)
