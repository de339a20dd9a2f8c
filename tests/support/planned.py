"""A navigated rover with a planner, and an executive on it in simulated time."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from executive.commands import Motion
from executive.preview import Preview, PreviewRun
from executive.settings import Settings
from executive.values.facts import PlannedPath
from executive.values.geometry import Point, Pose, TargetFrame
from executive.values.ports import DriveBy, NavigateTo, PathRequest, TurnBy
from executive.values.reasons import Refusal
from executive.values.reports import Report, Stage
from tests.support.kinematic import Bench
from tests.support.navigated import NavigatedRover
from tests.support.navigation import Navigation


@dataclass
class PlannedRover(NavigatedRover):
    """Its planner answers with these points, with none and a reason, or not at all (None)."""

    via: tuple[Point, ...] | str | None = ()
    requests: list[PathRequest] = field(default_factory=list)

    def plan_path(self, request: PathRequest) -> None:
        self.requests.append(request)
        if isinstance(self.via, str):
            self.facts.append(PlannedPath(request.number, (), self.via))
        elif self.via is not None:
            points = request.start.point, *self.via, request.goal.point
            self.facts.append(PlannedPath(request.number, points))

    def _poses_of(self, task: NavigateTo | TurnBy | DriveBy) -> tuple[list[Pose], bool]:
        """Let the navigation follow the path."""
        poses, relative = super()._poses_of(task)
        via = self.via if isinstance(self.via, tuple) and not relative else ()
        in_map = isinstance(task, NavigateTo) and task.frame is TargetFrame.MAP
        origin = self.map_to_odom.inverse if in_map and self.map_to_odom else Pose()
        return [*(origin.compose(Pose(each.x_m, each.y_m)) for each in via), *poses], relative


class PlannedBench(Bench):
    """An executive over a rover with a planner."""

    rover: PlannedRover

    def __init__(self, folder: Path, asset: Settings) -> None:
        assert asset.navigation is not None
        navigation = Navigation(speed_mps=asset.navigation.speed_mps)
        rover = PlannedRover(gate=asset.navigation.gate, navigation=navigation)
        super().__init__(folder, asset, rover=rover)

    def texts(self, number: int) -> list[str]:
        """Return the texts of a command's progress."""
        return [each.text for each in self.of(number) if each.stage is Stage.PROGRESS]

    def of(self, number: int) -> Iterator[Report]:
        """Return the reports of a command."""
        reports = self.received.reports
        return (each for each in reports if each.identity and each.identity.command_id == number)

    def previewed(self, motion: Motion) -> Preview | Refusal:
        """Preview a motion as the link does: the planner's answers arrive as facts."""
        run = self.executive.preview(motion)
        if isinstance(run, Refusal):
            return run
        run.set_up()
        while not run.advance(7):
            self.answer(run)
        assert run.result is not None
        return run.result

    def answer(self, run: PreviewRun) -> None:
        """Answer the request of a preview."""
        wanted = run.path_request
        if wanted is None:
            return
        request = self.executive.predictions.request_path(wanted)
        assert request is not None
        self.run(0.1)
        path = self.executive.status.planned_path(request.number)
        run.provide_path(path or PlannedPath(request.number, (), "no path in time"))
