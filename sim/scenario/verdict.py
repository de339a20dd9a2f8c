"""What came of each expectation: whether it holds, and what was seen."""

from typing import assert_never

from sim.scenario.expectations import (
    CommandLife,
    Events,
    Expectation,
    FileFetched,
    FileLife,
    FileList,
    LinkTells,
    ModeIs,
    ParameterIs,
    Pictures,
    PlanIs,
    PoseIs,
    RoverMoves,
    TelemetryCount,
    VideoComes,
)
from sim.scenario.finding import Finding
from sim.scenario.judge_commands import (
    commands_end_once,
    events,
    file_fetched,
    file_life,
    file_list,
    life,
    link_tells,
    plan,
    reports_without_gap,
)
from sim.scenario.judge_state import (
    mode,
    movement,
    parameter,
    pictures,
    pose,
    stands_while_held,
    telemetry,
    video,
)
from sim.scenario.model import Scenario
from sim.scenario.record import Record


def judge(scenario: Scenario, record: Record) -> list[Finding]:
    """Return a finding for each expectation, then one for each promise.

    Promises are what every run must keep, whatever the file expects: the whole timeline was
    played, every command ends exactly once, reports are numbered without gaps, and the rover
    stands while it is STOPPED or SAFE.
    """
    played = Finding(
        "promise",
        f"all {len(scenario.timeline)} entries of the timeline are played",
        f"{record.played} were",
        record.played == len(scenario.timeline),
    )
    return [
        *(_finding(expected, record) for expected in scenario.expect),
        played,
        commands_end_once(record),
        reports_without_gap(record),
        stands_while_held(record),
    ]


def _finding(expected: Expectation, record: Record) -> Finding:
    match expected:
        case CommandLife():
            return life(expected, record)
        case PoseIs():
            return pose(expected, record)
        case ParameterIs():
            return parameter(expected, record)
        case TelemetryCount():
            return telemetry(expected, record)
        case RoverMoves():
            return movement(expected, record)
        case ModeIs():
            return mode(expected, record)
        case Pictures():
            return pictures(expected, record)
        case Events():
            return events(expected, record)
        case LinkTells():
            return link_tells(expected, record)
        case PlanIs():
            return plan(expected, record)
        case FileLife():
            return file_life(expected, record)
        case FileList():
            return file_list(expected, record)
        case FileFetched():
            return file_fetched(expected, record)
        case VideoComes():
            return video(expected, record)
        case _:
            assert_never(expected)
