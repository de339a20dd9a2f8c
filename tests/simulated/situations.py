"""Situations that storms found, or find rarely, each as short as it can be."""

from dataclasses import replace
from typing import Final

from executive.commands import MoveForward, Resume, SetTravelSpeed, Stop
from tests.simulated.convergence import Convergence
from tests.simulated.deeds import (
    CutChannel,
    Deed,
    FailWrite,
    FillDisk,
    Kill,
    KillAtWrite,
    Link,
    LoseSamples,
    Order,
    Pause,
    Situation,
    StepClock,
    Storm,
    Unplug,
)

CALM: Final = Situation(
    delay_s=0.02,
    jitter_s=0.0,
    loss=0.0,
    duplicate=0.0,
    eclipse_s=0.0,
    contact_s=0.0,
    retransmit_after_s=None,
    period_s=60.0,
)


def _storm(*deeds: Deed) -> Storm:
    return Storm("situation", CALM, deeds)


QUIET_S: Final = 30.0
"""Enough after the last fault here, where no pause between two attempts has grown long."""
FULL_FOR_MINUTES: Final = _storm(
    FillDisk(15.0, "executive", 90.0),
    Order(20.0, Link.RELAY, 1, Stop()),
    Order(22.0, Link.RELAY, 2, Resume()),
    Order(23.0, Link.RELAY, 3, MoveForward(0.2)),
    Order(150.0, Link.RELAY, 4, Resume()),
)
"""Commands wait at rover-relay for longer than it takes to publish them 30 times."""
FORGOTTEN_ON_FULL_DISK: Final = _storm(
    FillDisk(15.0, "executive", 55.0),
    Order(20.0, Link.RELAY, 1, SetTravelSpeed(0.2)),
    Kill(60.0, "executive", 2.0),
)
"""The executive takes a command that it cannot write down, and is killed long after."""
LATE_REPORT: Final = _storm(
    *(Order(24.9 + 0.02 * n, Link.RELAY, 1 + n, SetTravelSpeed(0.2)) for n in range(6)),
    CutChannel(25.0, "orbiter", "relay", 0.3),
    *(Order(25.32 + 0.02 * n, Link.RELAY, 7 + n, SetTravelSpeed(0.2)) for n in range(4)),
    Kill(25.5, "orbiter", 1.0),
    CutChannel(25.6, "moe", "orbiter", 20.0),
)
"""Reports are lost, overtaken by others, and sent again while the ground is not connected."""
REFUSED_UNHEARD: Final = _storm(
    Order(15.0, Link.DIRECT, 1, Stop()),
    Order(16.0, Link.DIRECT, 2, MoveForward(0.2)),
    Pause(18.0, "executive", 10.0),
    Order(20.0, Link.RELAY, 2, MoveForward(0.3)),
    Kill(22.0, "orbiter", 2.0),
    CutChannel(22.1, "moe", "orbiter", 20.0),
)
"""The refusal of a number that is used has none, and comes down while nobody is connected."""
STOP_TWICE: Final = _storm(
    Kill(19.0, "executive", 10.0),
    Order(20.0, Link.RELAY, 1, Stop()),
    Order(21.0, Link.RELAY, 1, Stop()),
)
"""The same stop waits twice at rover-relay for its confirmation."""
REPEAT_ANSWERED: Final = tuple(
    _storm(
        Order(20.0, Link.DIRECT, 1, SetTravelSpeed(0.2)),
        Order(20.0, Link.DIRECT, 2, SetTravelSpeed(0.3)),
        Order(25.0, Link.RELAY, 1, SetTravelSpeed(0.2)),
        Order(25.0, Link.RELAY, 2, SetTravelSpeed(0.3)),
        KillAtWrite(25.0, "relay", writes, after, 2.0),
    )
    for writes, after in ((3, True), (4, False), (4, True), (5, False))
)
"""rover-relay is killed about when it stores the answers to repeats."""
FIRST_REPORT: Final = _storm(
    CutChannel(0.0, "orbiter", "relay", 30.0),
    Order(20.0, Link.RELAY, 1, SetTravelSpeed(0.3)),
    Kill(22.0, "orbiter", 1.0),
    CutChannel(22.1, "moe", "orbiter", 20.0),
)
"""The ground receives nothing before its connection is lost, and all that comes is missed."""
STOP_OUTLASTS_RELAY: Final = _storm(
    CutChannel(20.0, "orbiter", "relay", 0.3),
    Order(20.1, Link.RELAY, 1, MoveForward(0.3)),
    Order(20.35, Link.RELAY, 2, Stop()),
    Kill(20.5, "relay", 2.0),
    Order(21.0, Link.DIRECT, 3, Resume()),
    Kill(40.0, "executive", 1.0),
)
"""A stop overtakes a motion, rover-relay is killed, and the rover is resumed before it comes."""
POWER_LOST: Final = _storm(
    CutChannel(19.0, "orbiter", "relay", 10.0),
    *(Order(20.0 + n, Link.RELAY, 1 + n, SetTravelSpeed(0.2)) for n in range(4)),
    Kill(24.0, "orbiter", 2.0, power=True),
)
"""The orbiter loses power with commands that it has acknowledged and not sent."""
REFUSED_THEN_EXECUTED: Final = _storm(
    FillDisk(15.0, "executive", 10.0),
    Order(16.0, Link.DIRECT, 1, SetTravelSpeed(0.2)),
    Order(20.0, Link.RELAY, 2, Resume()),
    KillAtWrite(20.0, "relay", 3, True, 8.0),
)
"""rover-relay is killed when it has stored a refusal that the ledger aboard knows nothing of."""
STOP_REFUSED_THEN_EXECUTED: Final = _storm(
    FillDisk(15.0, "executive", 40.0),
    Order(16.0, Link.DIRECT, 1, Resume()),
    KillAtWrite(20.0, "relay", 3, True, 45.0),
    Order(20.0, Link.RELAY, 2, Stop()),
)
"""The same of a stop, which is accepted in every mode."""
HALF_OPEN: Final = _storm(
    CutChannel(19.0, "orbiter", "relay", 10.0),
    Order(20.0, Link.RELAY, 1, SetTravelSpeed(0.2)),
    Kill(24.0, "orbiter", 2.0, power=True),
)
"""The orbiter loses power while the ground only listens."""
FORGOTTEN_CONNECTION: Final = Storm(
    "situation",
    replace(CALM, delay_s=3.0),  # the reports come when the connection is half open
    (
        Order(20.0, Link.RELAY, 1, MoveForward(0.2)),
        CutChannel(20.5, "moe", "orbiter", 10.0),
        Kill(21.0, "orbiter", 1.0),
    ),
)
"""The ground only listens, and its orbiter has forgotten the connection."""
MOCUP: Final = replace(CALM, retransmit_after_s=60.0, mocup=True)
REFUSED_THEN_PLUGGED: Final = tuple(
    Storm(
        "situation",
        MOCUP,
        (
            Unplug(15.0, 8.0),
            Order(20.0, Link.RELAY, 1, MoveForward(0.2)),
            KillAtWrite(20.0, "relay", 3, after, 4.0),
        ),
    )
    for after in (False, True)
)
"""rover-relay is killed before it stores that a command was delivered; it was refused meanwhile."""
END_UNRECORDED: Final = Storm(
    "situation",
    MOCUP,
    (
        Order(20.0, Link.RELAY, 1, MoveForward(0.4)),
        FillDisk(21.0, "nxt", 4.5),
        Kill(25.0, "nxt", 2.0),
    ),
)
"""The brick ends a command while the disk of rover-nxt is full, which is killed then."""
REPLY_LOST: Final = Storm(
    "situation",
    MOCUP,
    (
        Order(20.0, Link.RELAY, 1, MoveForward(0.4)),
        LoseSamples(21.0, 1.0, 2.0),
        Order(24.0, Link.RELAY, 2, Stop()),
    ),
)
"""The brick's reply is lost, and a stop keeps the orbiter from asking for it again."""
STOP_UNRECORDED: Final = Storm(
    "situation",
    MOCUP,
    (
        Order(20.0, Link.RELAY, 1, Stop()),
        FillDisk(22.0, "nxt", 5.0),
        Order(23.0, Link.RELAY, 2, Stop()),
        KillAtWrite(23.0, "relay", 4, False, 2.0),
        Kill(23.5, "nxt", 1.0),
    ),
)
"""A stop comes while the disk of rover-nxt is full, which is killed."""
NXT_POWER_LOST: Final = Storm(
    "situation",
    MOCUP,
    (
        *(Order(20.0, Link.RELAY, 1 + n, MoveForward(0.4)) for n in range(4)),
        Kill(22.0, "nxt", 2.0, power=True),
    ),
)
"""rover-nxt loses power with a command at the brick, and others that it has acknowledged."""
CLAIMED_WHILE_WAITING: Final = Storm(
    "situation",
    MOCUP,
    (
        Order(20.0, Link.RELAY, 1, MoveForward(0.4)),
        Order(20.5, Link.RELAY, 2, MoveForward(0.2)),
        KillAtWrite(21.0, "nxt", 2, True, 2.0),
        Order(21.0, Link.DIRECT, 2, MoveForward(0.2)),
        Kill(21.1, "executive", 9.0),
        Unplug(21.2, 8.0),
        Order(22.0, Link.RELAY, 3, Stop()),
    ),
)
"""rover-nxt is killed when it has stored that the executive has what waits for the relay."""
RECOVERED_UNRECORDED: Final = _storm(
    Kill(15.0, "executive", 20.0),
    Order(20.0, Link.RELAY, 1, SetTravelSpeed(0.3)),
    KillAtWrite(20.0, "orbiter", 2, False, 2.0),
    FailWrite(21.0, "orbiter", 1),
    Kill(22.1, "relay", 1.0),
)
"""The orbiter cannot record what it finds in its outbox; the ground sends it again meanwhile."""
RECOVERY_KILLED: Final = _storm(
    *(Order(20.0, Link.RELAY, number, SetTravelSpeed(0.2)) for number in range(1, 4)),
    KillAtWrite(20.0, "orbiter", 2, False, 2.0),
    KillAtWrite(21.0, "orbiter", 1, True, 2.0),
    Kill(21.5, "moe", 5.0),
)
"""The orbiter is killed again when it has recorded one of the commands found in its outbox."""
ANNOUNCEMENT_LOST: Final = Storm(
    "situation",
    MOCUP,
    (
        Order(20.0, Link.DIRECT, 1, MoveForward(0.2)),
        Order(20.5, Link.RELAY, 1, MoveForward(0.2)),
        LoseSamples(21.45, 1.0, 0.2),
    ),
)
"""What the executive reports at the end of a command, of which the relay has a copy, is lost."""
CLOCK_SET_BACK: Final = Storm(
    "situation",
    replace(CALM, convergence=Convergence.UDP),
    (
        CutChannel(19.0, "orbiter", "relay", 3.0),
        Order(20.0, Link.RELAY, 1, SetTravelSpeed(0.2)),
        StepClock(21.0, "orbiter", -900.0),
    ),
)
"""A bundle is lost, and the orbiter's clock is set back before it is sent again."""
CLOCK_SET_BACK_WHILE_DOWN: Final = replace(
    CLOCK_SET_BACK,
    deeds=(*CLOCK_SET_BACK.deeds[:2], Kill(20.8, "orbiter", 2.0), CLOCK_SET_BACK.deeds[2]),
)
"""The same, while the orbiter's process is down."""
CONSOLE: Final = replace(CALM, console=True)
CONSOLE_POWER_LOST: Final = Storm(
    "situation",
    CONSOLE,
    (
        Order(20.0, Link.CONSOLE, 1, SetTravelSpeed(0.2)),
        Kill(20.1, "console", 2.0, power=True),
        Order(25.0, Link.CONSOLE, 1, SetTravelSpeed(0.2)),
    ),
)
"""The console loses power just after a command, which the page posts again."""
SAME_MILLISECOND: Final = Storm(
    "situation",
    CONSOLE,
    (
        *(Order(20.0, Link.CONSOLE, 3 + 4 * n, MoveForward(0.2)) for n in range(3)),
        *(Order(20.0, Link.CONSOLE, 12 + n, Stop()) for n in range(3)),
    ),
)
"""The page posts commands by the relay, and stops, at once."""
CONSOLE_FORGETS: Final = Storm(
    "situation",
    CONSOLE,
    (
        Kill(20.0, "console", 2.0, power=True),
        *(Order(25.0 + n, Link.CONSOLE, 1 + n, SetTravelSpeed(0.2)) for n in range(2)),
    ),
)
"""The console loses power, and is back before the page misses it."""
REFUSED_UNWRITTEN: Final = Storm(
    "situation",
    CONSOLE,
    (FillDisk(19.0, "executive", 2.0), Order(20.0, Link.CONSOLE, 1, Stop())),
)
"""The executive cannot write a stop down at once, and refuses it; the rover stops all the same."""
ALL: Final = {
    "full for minutes": FULL_FOR_MINUTES,
    "forgotten on a full disk": FORGOTTEN_ON_FULL_DISK,
    "late report": LATE_REPORT,
    "refused unheard": REFUSED_UNHEARD,
    "stop twice": STOP_TWICE,
    **{f"repeat answered {number}": each for number, each in enumerate(REPEAT_ANSWERED, 1)},
    "first report": FIRST_REPORT,
    "stop outlasts relay": STOP_OUTLASTS_RELAY,
    "power lost": POWER_LOST,
    "power of rover-nxt lost": NXT_POWER_LOST,
    "refused, then executed": REFUSED_THEN_EXECUTED,
    "stop refused, then executed": STOP_REFUSED_THEN_EXECUTED,
    "half open": HALF_OPEN,
    "forgotten connection": FORGOTTEN_CONNECTION,
    **{f"refused, then plugged {n}": each for n, each in enumerate(REFUSED_THEN_PLUGGED, 1)},
    "end unrecorded": END_UNRECORDED,
    "reply lost": REPLY_LOST,
    "stop unrecorded": STOP_UNRECORDED,
    "recovered, unrecorded": RECOVERED_UNRECORDED,
    "claimed while waiting": CLAIMED_WHILE_WAITING,
    "recovery killed": RECOVERY_KILLED,
    "announcement lost": ANNOUNCEMENT_LOST,
    "clock set back": CLOCK_SET_BACK,
    "clock set back while down": CLOCK_SET_BACK_WHILE_DOWN,
    "console: power lost": CONSOLE_POWER_LOST,
    "console: same millisecond": SAME_MILLISECOND,
    "console: forgets a page": CONSOLE_FORGETS,
    "console: refused, unwritten": REFUSED_UNWRITTEN,
}
