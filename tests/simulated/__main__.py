"""Plays hours of operations in simulated time: `./rover test --simulated HOURS`."""

import hashlib
import logging
import sys
from dataclasses import replace
from itertools import count

import click

from tests.simulated.deeds import Storm, draw_console_storm, draw_mocup_storm, draw_storm
from tests.simulated.shrink import shrink
from tests.simulated.storm import Played, play
from tests.simulated.timeline import timeline

_HOUR_S = 3600.0
_KINDS = (
    *(draw_storm, draw_storm, draw_storm, draw_mocup_storm),
    *(draw_storm, draw_console_storm, draw_storm, draw_mocup_storm),
)
"""One storm of four is over MOCUP, one of eight over a console."""


@click.command()
@click.argument("hours", type=click.FloatRange(min=0.0, min_open=True))
@click.option("--seed", default="1", show_default=True, help="Of the first storm.")
@click.option("--trace", is_flag=True, help="Show the timeline of what fails.")
def main(hours: float, seed: str, trace: bool) -> None:
    """Play storms until HOURS of operations have passed, and print what they broke.

    \b
    Exit status:
      0  no promise was broken
      1  one was; its storm is printed, reduced to the fewest deeds
    """
    logging.basicConfig(level=logging.CRITICAL)
    whole, simulated_s, kills = hashlib.sha256(), 0.0, 0
    for number in count():
        storm = _KINDS[number % len(_KINDS)](seed if number == 0 else f"{seed}.{number}")
        played = play(storm)
        simulated_s, kills = simulated_s + played.simulated_s, kills + played.kills
        whole.update(played.digest.encode())
        click.echo(_line(storm, played))
        if played.findings:
            _explain(storm, played, trace)
            sys.exit(1)
        if simulated_s >= hours * _HOUR_S:
            break
    click.echo(f"{simulated_s / _HOUR_S:.2f} h of operations, {kills} kills: nothing was broken")
    click.echo(f"digest {whole.hexdigest()}")


def _line(storm: Storm, played: Played) -> str:
    situation = storm.situation
    kind = "MOCUP, " if situation.mocup else "console, " if situation.console else ""
    return (
        f"{kind}seed {storm.seed}: {played.simulated_s:.0f} s, {played.orders} commands,"
        f" {played.kills} kills, {played.events} events, digest {played.digest[:16]}"
    )


def _explain(storm: Storm, played: Played, trace: bool) -> None:
    for finding in played.findings:
        click.secho(str(finding), fg="red")
    first = min(played.findings, key=lambda finding: finding.at_s)

    def breaks(shorter: Storm) -> bool:
        return any(finding.what == first.what for finding in play(shorter).findings)

    click.echo("Looking for the shortest sequence that breaks it.")
    earlier = replace(storm, deeds=tuple(d for d in storm.deeds if d.at_s <= first.at_s))
    minimal = shrink(earlier if breaks(earlier) else storm, breaks)
    click.echo(f"{len(minimal.deeds)} of {len(storm.deeds)} deeds, in {minimal.situation}:")
    for deed in minimal.deeds:
        click.echo(f"  {deed}")
    if trace:
        for line in timeline(minimal):
            click.echo(line)


if __name__ == "__main__":
    main()
