"""Scenarios that are played over sockets, without processes."""

import time
from collections.abc import Callable, Mapping
from pathlib import Path

from sim.scenario.live_session import LiveSession
from sim.scenario.model import RunMode
from sim.scenario.reading import load_scenario
from sim.scenario.record import Record


async def play(
    folder: Path,
    mode: RunMode,
    uris: Mapping[str, str],
    text: str,
    on_update: Callable[[Record], None] = lambda _: None,
    lasts_s: float = 60.0,
) -> Record:
    """Play the entries of a timeline, and return what was seen.

    What a rover reports whose time runs ahead is of the time when it is read.
    """
    path = folder / "played.yaml"
    path.write_text(
        f"title: T\nduration: {lasts_s:g}\ntimeline:{text}\nexpect: [{{pictures: 0}}]\n"
    )
    scenario = load_scenario(str(path), mode)
    record = Record(time.time(), folder, lambda utc_s: min(utc_s, time.time()))
    await LiveSession(
        scenario, uris, mode, None, None, lambda: None, record, brief=True, on_update=on_update
    ).play()
    return record
