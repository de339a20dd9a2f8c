"""A session of a console with a rover, so that both store something of everything; a recording."""

from pathlib import Path
from typing import Any, Final

from executive.commands import Command, MoveForward, MoveTo, Resume, Stop, TakePicture, Waypoint
from executive.commands.lifecycle import SubmitResult
from executive.core.recording import RecordingSink
from executive.core.runner import Executive
from executive.values.clock import START_UTC_S
from executive.values.reports import PlanStatus, Stage
from tests.console.conftest import NEEDED
from tests.console.consoles import ALL, Operator, at_console
from tests.console.test_alarms import BATTERY, FULL_V, LOW_V, acknowledge, is_alarm, show
from tests.core.test_ledger_writer import SlowDisk
from tests.mrs.aboard import Aboard
from tests.support.plans import PlanBench, plan
from tests.support.timed_system import TimedSystem

PLAN: Final = """<Sequence>
  <moveForward distance="0.5" deadline_s="60"/>
  <takePicture deadline_s="20"/>
  <moveForward distance="4" deadline_s="60"/>
  <rotateBy angle="0.5" deadline_s="60"/>
</Sequence>"""
PICTURE: Final = "pictures/rock.jpg"
COMMIT_S: Final = 0.03
PENDING: Final = ("active", "queued")
"""Commands of the console that have not ended when the rover loses its power."""
DRIVEN: Final = {
    1: Stage.EXECUTED,
    2: Stage.REJECTED,
    3: Stage.EXECUTED,
    4: Stage.CANCELLED,
    5: Stage.EXECUTED,
    6: Stage.EXECUTED,
}
"""Ends of the commands of MOE in the recording."""
PATHS: Final = (
    "api/dictionary",
    "api/authority",
    "api/commands?asset=jackal",
    "api/notifications?asset=jackal",
    "api/alarms",
    "api/records/asset?asset=jackal",
    "api/records/plan?asset=jackal",
    "api/tm/jackal/BATERY_VOLTAGE",
    "api/plans/jackal",
    "api/plans/jackal/1",
    "api/plans/templates",
    "api/objects",
    "api/objects/view",
    "api/files/jackal",
    "api/transfers",
    "api/obstacles/jackal",
    "api/why/jackal",
    "healthz",
)
"""What a program queries from the console."""


class Then(TimedSystem):
    """The computer on the day of the session: the retention deletes nothing of it."""

    def __init__(self) -> None:
        super().__init__(lambda: START_UTC_S + 5.0)


def launched(folder: Path) -> Aboard:
    """Return a rover with its data in a folder; its time runs."""
    rover = Aboard(folder, authority=NEEDED, explains=True)
    rover.runs = True
    return rover


async def answers(anna: Operator) -> dict[str, Any]:
    """Return the answers to a program."""
    return {path: await anna.get(path) for path in PATHS}


async def work(folder: Path) -> dict[str, Any]:
    """Hold the session, with data in `rover` and `console`; return the console's answers."""
    rover = launched(folder / "rover")
    rover.put(PICTURE, b"\xff\xd8\xff\xd9")
    topics = (*ALL, "tm", "tree", "transfer")
    async with at_console(folder, rover.uri, "anna", topics=topics, system=Then()) as (anna,):
        await anna.page.is_up()
        await anna.authority("request")
        await _end(anna, "drive", "executed", "moveForward", distance=0.5)
        await _end(anna, "far", "rejected", "moveTo", x=500.0, y=0.0)
        await _end(anna, "speed", "executed", "setTravelSpeed", speed=0.4)
        await _end(anna, "picture", "executed", "takePicture")
        await _suspended_plan(anna)
        await _files_and_alarms(anna, rover)
        await anna.send(PENDING[0], "moveForward", distance=50.0)
        await anna.page.command(PENDING[0], "started")
        await anna.send(PENDING[1], "moveForward", distance=1.0)
        await anna.page.command(PENDING[1], "accepted")
        found = await answers(anna)
        rover.die()
    return found


class _SlowDiskBench(PlanBench):
    """A bench with commits that end between ticks; its recording has the writer's states."""

    def _start(self) -> Executive:
        executive = super()._start()
        SlowDisk(self).commit_s = COMMIT_S
        return executive

    def send(self, command: Command) -> SubmitResult:
        """Send a command, and let time pass until it is answered."""
        answers: list[SubmitResult] = []
        self.executive.submit(command, answers.append)
        self.executive.serve_inbox()
        while not answers:
            self.step()
        return answers[0]


def drive(folder: Path, tape: RecordingSink) -> None:
    """Record a drive with a refusal, a stop, a plan and a loss of power, on a slow disk."""
    with _SlowDiskBench(folder, tape=tape) as bench:
        bench.execute(MoveTo(Waypoint(1.0, 0.5, 1.0)), 1)
        bench.refusal(MoveTo(Waypoint(500.0, 0.0)), 2)
        bench.execute(TakePicture(), 3)
        bench.submit(MoveForward(5.0), 4)
        bench.run(1.0)
        bench.submit(Stop(), 5)
        bench.run(1.0)
        bench.execute(Resume(), 6)
        bench.begin(PLAN, 4.0)
        bench.crash()
        bench.run(0.5)
        bench.resumed()


async def _end(anna: Operator, name: str, state: str, command: str, **args: Any) -> None:
    await anna.send(name, command, **args)
    await anna.page.command(name, state)


async def _suspended_plan(anna: Operator) -> None:
    content = plan(PLAN).content.decode()
    await anna.post("api/plans/jackal", id="plan", plan_id="survey", content=content)
    await anna.page.command("plan", "executed")
    await anna.send("go", "activatePlan", plan_id="survey")
    await anna.page.until(lambda text: text["ty"] == "plan" and text["done"] == 2)
    await anna.post("api/stop/jackal", id="stop")
    status = PlanStatus.SUSPENDED.name
    await anna.page.until(lambda text: text["ty"] == "plan" and text["status"] == status)
    await _end(anna, "again", "executed", "resume")


async def _files_and_alarms(anna: Operator, rover: Aboard) -> None:
    show(rover, LOW_V)
    await acknowledge(anna, await anna.page.until(is_alarm(BATTERY)))
    show(rover, FULL_V)
    headers = {"If-None-Match": "*"}
    await anna.request("PUT", "api/objects/view", json={"value": 1}, headers=headers)
    await anna.request("POST", "api/transfers", json={"asset": "jackal", "path": PICTURE})
    await anna.page.until(lambda text: text["ty"] == "transfer" and text["state"] == "done")
    await _end(anna, "on", "executed", "resume")
