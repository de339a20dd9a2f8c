"""The timeline of a storm for people: deeds, starts and ends of processes, and their logs."""

import logging
from collections.abc import Iterator
from typing import Final

from tests.simulated.deeds import Storm
from tests.simulated.storm import Player, player

_BEFORE_S: Final = 1.0
"""How long before its first deed it begins."""


class _Lines(logging.Handler):
    """Takes what the product logs, with the simulated time and the process."""

    def __init__(self, playing: Player) -> None:
        super().__init__(logging.INFO)
        self._world = playing.world
        self.lines: list[tuple[float, str]] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keep a line."""
        running = self._world.running
        source = "" if running is None else running.process.name
        text = f"{source:<10} {record.levelname.lower():<8} {record.getMessage()}"
        self.lines.append((self._world.now_s, text))


def timeline(storm: Storm) -> Iterator[str]:
    """Play a storm, and yield its lines in the order of time."""
    trace: list[str] = []
    logs = [logging.getLogger(name) for name in ("adapters", "executive", "trees")]
    before = [(log, log.level, log.propagate) for log in logs]
    with player(storm, trace) as playing:
        handler = _Lines(playing)
        for log in logs:
            log.addHandler(handler)
            log.setLevel(logging.INFO)
            log.propagate = False
        try:
            played = playing.play()
        finally:
            for log, level, propagates in before:
                log.removeHandler(handler)
                log.setLevel(level)
                log.propagate = propagates
    lines = [(deed.at_s, f"{'':<10} {deed}") for deed in storm.deeds]
    for line in trace:
        when, _, what = line.rstrip("\n").partition(" ")
        if " ends with " in what or what.endswith((" starts", " pauses", " resumes")):
            lines.append((float(when), f"{what.partition(' ')[0]:<10} {what}"))
    lines += handler.lines
    lines += ((finding.at_s, f"{'':<10} FINDING  {finding}") for finding in played.findings)
    begin_s = min((deed.at_s for deed in storm.deeds), default=0.0) - _BEFORE_S
    for time_s, text in sorted(lines, key=lambda line: line[0]):
        if time_s >= begin_s:
            yield f"{time_s:10.3f}  {text}"
