"""The timeline of a storm for people: deeds, starts and ends of processes, and their logs."""

import logging
from collections.abc import Iterator

from tests.simulated.deeds import Storm
from tests.simulated.storm import Player, player


class _Lines(logging.Handler):
    """Takes what the product logs, with the simulated time and the process."""

    def __init__(self, playing: Player) -> None:
        super().__init__(logging.INFO)
        self._world = playing.world
        self.lines: list[tuple[float, str]] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keep a line."""
        running = self._world.running
        who = "" if running is None else running.process.name
        text = f"{who:<10} {record.levelname.lower():<8} {record.getMessage()}"
        self.lines.append((self._world.now_s, text))


def timeline(storm: Storm) -> Iterator[str]:
    """Play a storm, and yield its lines in the order of time."""
    trace: list[str] = []
    logs = [logging.getLogger(name) for name in ("adapters", "executive", "trees")]
    with player(storm, trace) as playing:
        handler = _Lines(playing)
        levels = [log.level for log in logs]
        for log in logs:
            log.addHandler(handler)
            log.setLevel(logging.INFO)
        try:
            played = playing.play()
        finally:
            for log, level in zip(logs, levels, strict=True):
                log.removeHandler(handler)
                log.setLevel(level)
    lines = [*handler.lines, *((deed.at_s, f"{'':<10} {deed}") for deed in storm.deeds)]
    for line in trace:
        when, _, what = line.rstrip("\n").partition(" ")
        if " ends with " in what or what.endswith((" starts", " pauses", " resumes")):
            lines.append((float(when), f"{what.partition(' ')[0]:<10} {what}"))
    lines += ((finding.at_s, f"{'':<10} FINDING  {finding}") for finding in played.findings)
    for time_s, text in sorted(lines, key=lambda line: line[0]):
        yield f"{time_s:10.3f}  {text}"
