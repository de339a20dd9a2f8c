"""Mission control plays scripts over a real socket, to a rover whose time runs fast."""

import asyncio
import re
from collections.abc import Iterator, Sequence
from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console
from rich.text import Text

from adapters.mrs.ground.client import MrsClient
from adapters.mrs.spec.types import Stage
from executive.commands.catalogue import (
    FollowPath,
    MoveForward,
    MoveTo,
    Resume,
    SetCameraAngles,
    Stop,
    Waypoint,
)
from sim.demo.display import LineDisplay, TerminalDisplay, lives_table
from sim.demo.script import JACKAL, AtOnce, Ending, Link, Step, WhenDone, WhenNear
from sim.demo.session import Life, RoverStatus, Session, until_first
from tests.mrs.aboard import Aboard


class Audience:
    """Notes what it is shown."""

    def __init__(self) -> None:
        self.x_m: dict[tuple[str, Stage | None], float] = {}
        self._x_m = 0.0

    def changed(self, life: Life) -> None:
        self.x_m[life.spelled, life.stage] = self._x_m

    def looked(self, status: RoverStatus) -> None:
        self._x_m = status.x_m


@pytest.fixture
def aboard(tmp_path: Path) -> Iterator[Aboard]:
    rover = Aboard(tmp_path)
    rover.runs = True
    yield rover
    rover.close()


def play(aboard: Aboard, script: Sequence[Step], audience: Audience) -> Session:
    async def session(client: MrsClient) -> Session:
        session = Session({Link.DIRECT: client}, audience)
        await session.play(script)
        return session

    return aboard.ground(session)


def test_a_script_is_played_to_its_end(aboard: Aboard) -> None:
    target = Waypoint(90.0, 0.0)  # time aboard runs: it is not to be there before the stop
    audience = Audience()
    played = play(
        aboard,
        (
            Step(MoveTo(target), WhenDone(), Ending.CANCELLED),
            Step(SetCameraAngles(0.5, 0.0), AtOnce()),
            Step(Stop(), WhenNear(target, 89.0)),
            Step(MoveForward(1.0), WhenDone(), Ending.REJECTED),
            Step(Resume(), WhenDone()),
            Step(MoveForward(-0.5), WhenDone()),
            Step(MoveForward(-0.5), WhenDone(), Ending.DUPLICATE, repeats=True),
        ),
        audience,
    )
    assert [life.ending for life in played.lives] == [life.step.expected for life in played.lives]
    assert all(life.as_expected for life in played.lives)
    assert played.lives[0].text.endswith("(reason 801)")
    assert "send resume first" in played.lives[3].text
    assert str(played.lives[5].command.identity.command_id) in played.lives[6].text
    assert 1.0 <= audience.x_m["stop", None] < 90.0
    assert ("moveForward -0.5", Stage.EXECUTED) in audience.x_m


def test_every_report_is_kept_once_and_in_order(aboard: Aboard) -> None:
    script = (
        Step(MoveForward(0.2), WhenDone()),
        Step(MoveForward(0.2), WhenDone(), Ending.DUPLICATE, repeats=True),
        Step(MoveForward(-0.2), WhenDone()),
    )
    played = play(aboard, script, Audience())
    assert [told.notification.sequence for told in played.reports[Link.DIRECT]] == list(
        range(1, 11)
    )


def test_an_ending_that_the_script_does_not_expect_is_told(aboard: Aboard) -> None:
    played = play(aboard, (Step(MoveForward(1e6), WhenDone()),), Audience())
    (life,) = played.lives
    assert life.ending is Ending.REJECTED
    assert not life.as_expected


def test_a_command_that_ends_short_of_a_place_keeps_no_later_one_back(aboard: Aboard) -> None:
    script = (
        Step(MoveForward(1e6), WhenDone()),
        Step(Stop(), WhenNear(Waypoint(3.0, 0.0), 0.5)),
    )
    played = play(aboard, script, Audience())
    assert [life.ending for life in played.lives] == [Ending.REJECTED, Ending.EXECUTED]


def test_a_command_that_never_ends_is_named(
    aboard: Aboard, monkeypatch: pytest.MonkeyPatch
) -> None:
    aboard.runs = False
    monkeypatch.setattr("sim.demo.session.LONGEST_S", 2.0)
    with pytest.raises(TimeoutError, match=r"moveForward 1 did not end within 2 s"):
        play(aboard, (Step(MoveForward(1.0), WhenDone()),), Audience())


def test_output_that_is_no_terminal_is_lines_and_a_table(aboard: Aboard) -> None:
    console = Console(width=110)
    with console.capture() as printed, LineDisplay(console) as shown:

        async def session(client: MrsClient) -> None:
            audience = shown.audience(JACKAL)
            session = Session({Link.DIRECT: client}, audience)
            await session.play((Step(MoveForward(0.2), WhenDone()),))

        aboard.ground(session)
    lines = [line.split() for line in printed.get().splitlines() if "moveForward 0.2" in line]
    assert [words[4] for words in lines[:2]] == ["STARTED", "EXECUTED"]
    assert "\x1b" not in printed.get()


def test_on_a_narrow_terminal_each_command_keeps_to_its_line(aboard: Aboard) -> None:
    path = FollowPath(tuple(Waypoint(0.1 * i, 0.0) for i in range(1, 9)))
    script = (Step(path, WhenDone()), Step(MoveForward(1e6), WhenDone(), Ending.REJECTED))
    screen = StringIO()
    console = Console(file=screen, force_terminal=True, width=80, height=24)
    with TerminalDisplay(console) as shown:

        async def session(client: MrsClient) -> Sequence[Life]:
            session = Session({Link.DIRECT: client}, shown.audience(JACKAL))
            await session.play(script)
            return session.lives

        lives = aboard.ground(session)
    with console.capture() as printed:
        console.print(lives_table(lives, brief=True))
    drawn = Text.from_ansi(printed.get()).plain.splitlines()
    assert [line.split()[0] for line in drawn] == ["#", "1", "2"]
    assert all(len(line) <= 80 for line in drawn)
    assert "1e+06 m is above its bound" in re.sub(r"\s+", " ", last_table(screen.getvalue()))


def last_table(screen: str) -> str:
    """Return what stands on the screen after all that was drawn over, in one column."""
    lines = Text.from_ansi(screen[screen.rindex("received") :]).plain.splitlines()
    return " ".join(line[60:] for line in lines)


def test_what_fails_first_is_raised_and_the_rest_cancelled() -> None:
    ended: list[str] = []

    async def endless() -> None:
        try:
            await asyncio.Event().wait()
        finally:
            ended.append("cancelled")

    async def fails() -> None:
        await asyncio.sleep(0)
        raise ConnectionError("gone")

    with pytest.raises(ConnectionError, match="gone"):
        asyncio.run(until_first(endless(), fails()))
    assert ended == ["cancelled"]
