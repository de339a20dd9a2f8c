"""How fast a day of operations passes in simulated time."""

import time
from random import Random
from typing import Final

from executive.commands import MoveForward, Resume, RotateBy, SetCameraAngles
from tests.simulated.deeds import Link, Order, Situation, Storm
from tests.simulated.storm import play
from tests.support.figures import Figure, Goal

DAY_S: Final = 86_400.0
_COMMANDS: Final = 500
_SETTLE_S: Final = 20.0
_DAY: Final = Situation(
    delay_s=2.0,
    jitter_s=0.1,
    loss=0.02,
    duplicate=0.0,
    eclipse_s=DAY_S / 12 / 3,
    contact_s=DAY_S / 12 * 2 / 3,
    retransmit_after_s=120.0,
    period_s=DAY_S,
)


def draw_day(hours: float, seed: int) -> Storm:
    """Draw commands by both links, 500 a day; nothing is killed."""
    chance, count = Random(f"day {seed}"), round(_COMMANDS * hours / 24.0)
    times = sorted(chance.uniform(_SETTLE_S, hours * 3600.0) for _ in range(count))
    requests = (MoveForward(0.5), RotateBy(0.5), SetCameraAngles(0.3, 0.0), Resume())
    orders = tuple(
        Order(at_s, chance.choice((Link.DIRECT, Link.RELAY)), number, chance.choice(requests))
        for number, at_s in enumerate(times, 1)
    )
    return Storm(f"day {seed}", _DAY, orders)


def measure(hours: float, seed: int) -> list[Figure]:
    """Play hours of a day with twelve eclipses, and measure."""
    began_s = time.process_time()
    played = play(draw_day(hours, seed))
    cpu_s = time.process_time() - began_s
    on = "one core's processor time"
    return [
        Figure("simulated operations", played.simulated_s / 3600.0, "h"),
        Figure("processor time", cpu_s, "s"),
        Figure(
            "as fast as time", played.simulated_s / cpu_s, "times", on, Goal(100.0, at_least=True)
        ),
        Figure("events", played.events / cpu_s, "/s", on),
        Figure("broken promises", len(played.findings), "", "", Goal(0.0)),
    ]
