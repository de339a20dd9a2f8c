"""MOCUP's plugin on a desk: what it sends, and what it tells."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adapters.mocup import MocupFact, MocupRover
from adapters.mocup.plugin import ANSWER_TIMEOUT_S, MAX_PENDING, RETRANSMIT_S
from adapters.mops import Message, encode, load_dictionary
from executive.commands.catalogue import Stop
from executive.values.clock import ManualClock
from executive.values.facts import (
    ExternalCommandEnded,
    ExternalCommandRunning,
    ExternalStop,
    MotionEnded,
    MotionStarted,
)
from executive.values.geometry import Velocity
from executive.values.ports import CameraIntent, DelegatedMotion, DriveBy, TurnBy, VelocityHold
from executive.values.reports import Identity

DICTIONARY = load_dictionary()
MOE7, MOE8 = Identity("MOE", 7), Identity("MOE", 8)
LINE = DelegatedMotion(1, DriveBy(1.5, 0.2), MOE7)
TURN = DelegatedMotion(2, TurnBy(0.5, 1.0), MOE7)
HOLD = DelegatedMotion(7, VelocityHold(Velocity(0.1, 0.2), 3.0), MOE7)


class Desk:
    """A plugin, and the ends of both its wires."""

    def __init__(self) -> None:
        self.clock = ManualClock()
        self.sent: list[Message] = []
        self.ended: list[MocupFact] = []
        self.rover = MocupRover(
            DICTIONARY, self.clock, self.send, self.ended.append, "EXEC", "MOCUP"
        )

    def send(self, message: Message) -> None:
        encode(message)
        self.sent.append(message)

    @property
    def commands(self) -> list[str]:
        return [message.command for message in self.sent]

    def answer(self, executed: bool = True, received: bool = True, *outputs: str) -> None:
        self.rover.on_reply(reply(self.sent[-1], executed, received, *outputs))


def reply(to: Message, executed: bool, received: bool = True, *outputs: str) -> Message:
    return replace(
        to,
        source=to.dest,
        dest=to.source,
        inputs=(),
        outputs=outputs,
        received=received,
        executed=executed,
    )


@pytest.fixture
def desk() -> Desk:
    return Desk()


def test_a_motion_is_sent_after_its_speed_and_its_end_is_reported(desk: Desk) -> None:
    desk.rover.execute_motion(LINE)
    assert [str(m).split("|")[3:5] for m in desk.sent] == [["SET_TRAVEL_SPEED", "0.2"]]
    desk.answer()
    assert [str(m).split("|")[3:5] for m in desk.sent[1:]] == [["MOVE_FORWARD", "1.5"]]
    assert desk.ended == []
    desk.answer(False, True, "STARTED")
    desk.answer()
    assert desk.ended == [MotionStarted(1), MotionEnded(1, True, "")]
    desk.rover.execute_motion(replace(LINE, number=2))
    assert desk.commands[2:] == ["MOVE_FORWARD"]


def test_a_velocity_is_held_by_the_brick(desk: Desk) -> None:
    desk.rover.execute_motion(HOLD)
    assert str(desk.sent[0]).split("|")[3:5] == ["DRIVE", "0.1,0.2,3.0"]


@pytest.mark.parametrize("received", [True, False])
def test_an_unexecuted_command_is_reported_with_the_reason(desk: Desk, received: bool) -> None:
    desk.rover.execute_motion(HOLD)
    desk.answer(False, received, "FAILED", "9", "motor stuck")
    assert desk.ended == [MotionEnded(7, False, "FAILED 9 motor stuck")]


def test_a_stop_does_not_wait_and_forgets_what_does(desk: Desk) -> None:
    desk.rover.execute_motion(LINE)
    desk.rover.execute_motion(TURN)
    desk.rover.halt()
    assert desk.commands == ["SET_TRAVEL_SPEED", "STOP"]
    desk.answer()
    assert desk.commands == ["SET_TRAVEL_SPEED", "STOP"]
    desk.rover.execute_motion(TURN)
    assert desk.commands[2:] == ["SET_ROTATE_SPEED"]


def test_it_moves_the_brick_from_the_order_to_the_answer(desk: Desk) -> None:
    moving = [desk.rover.moving]
    desk.rover.point_camera(CameraIntent(0.1, 0.2, 1.0))
    moving.append(desk.rover.moving)
    desk.answer()
    desk.rover.execute_motion(LINE)
    while desk.commands[-1] != "MOVE_FORWARD":
        moving.append(desk.rover.moving)
        desk.answer()
    moving.append(desk.rover.moving)
    desk.answer()
    assert [*moving, desk.rover.moving] == [False, False, True, True, True, False]


def test_the_end_of_a_stopped_motion_is_reported(desk: Desk) -> None:
    desk.rover.execute_motion(LINE)
    desk.answer()
    motion = desk.sent[-1]
    desk.rover.halt()
    desk.rover.on_reply(reply(motion, False, True, "CANCELLED"))
    assert desk.ended == [MotionEnded(1, False, "CANCELLED")]
    assert desk.commands[-1] == "STOP"


def test_a_stop_by_the_other_link_ends_active_and_queued_requests(desk: Desk) -> None:
    desk.rover.execute_motion(LINE)
    desk.rover.execute_motion(TURN)
    stop = DICTIONARY.command(Stop(), Identity("MOE", 40), "MOCUP")
    desk.rover.on_reply(reply(stop, False, True, "STARTED"))
    ends = [MotionEnded(number, False, "STARTED") for number in (1, 2)]
    assert desk.ended == [ExternalStop(Identity("MOE", 40)), *ends]
    assert desk.commands == ["SET_TRAVEL_SPEED"]
    desk.rover.execute_motion(HOLD)
    assert desk.commands == ["SET_TRAVEL_SPEED", "DRIVE"]
    desk.rover.on_reply(reply(stop, True, True, "EXECUTED"))
    desk.rover.halt()
    own = desk.sent[-1]
    desk.ended.clear()
    for _ in range(2):
        desk.rover.on_reply(reply(own, True, True, "EXECUTED"))
    assert not any(isinstance(fact, ExternalStop) for fact in desk.ended)


def test_a_brick_that_went_away_blocks_nothing_after_a_stop(desk: Desk) -> None:
    desk.rover.execute_motion(LINE)
    desk.answer()
    desk.rover.halt()
    desk.answer()
    desk.rover.execute_motion(TURN)
    assert desk.commands[-1] == "SET_ROTATE_SPEED"
    desk.clock.advance(ANSWER_TIMEOUT_S)
    desk.rover.execute_motion(TURN)
    assert desk.commands[-1] == "ROTATE_BY"


def test_an_unanswered_request_is_resent_under_its_number(desk: Desk) -> None:
    desk.rover.execute_motion(TURN)
    for _ in range(3):
        desk.rover.retransmit()
    assert len(desk.sent) == 1
    desk.clock.advance(RETRANSMIT_S)
    desk.rover.retransmit()
    desk.rover.retransmit()
    assert desk.sent == [desk.sent[0]] * 2
    desk.answer()
    desk.clock.advance(RETRANSMIT_S)
    desk.rover.retransmit()
    assert desk.commands == ["SET_ROTATE_SPEED", "SET_ROTATE_SPEED", "ROTATE_BY", "ROTATE_BY"]
    desk.answer(False, True, "STARTED")
    desk.clock.advance(100.0)
    desk.rover.retransmit()
    assert len(desk.sent) == 4


def test_a_setting_that_is_never_answered_holds_nothing_up_for_long(desk: Desk) -> None:
    desk.rover.execute_motion(TURN)
    for _ in range(4):
        desk.clock.advance(RETRANSMIT_S)
        desk.rover.retransmit()
    assert desk.commands[-1] == "ROTATE_BY"


def test_the_camera_receives_new_angles_once_and_old_ones_after_a_while(desk: Desk) -> None:
    for _ in range(10):
        desk.rover.point_camera(CameraIntent(0.5, 0.1, 1.0, MOE7))
    assert desk.commands == ["SET_CAMERA_ROTATE_SPEED"]
    desk.answer()
    assert desk.commands[1:] == ["SET_CAMERA_ANGLES"]
    desk.rover.point_camera(CameraIntent(0.6, 0.1, 1.0, MOE8))
    desk.rover.point_camera(CameraIntent(0.7, 0.1, 1.0, MOE8))
    desk.answer()
    desk.answer()
    assert [message.inputs[0] for message in desk.sent] == ["1.0", "0.5", "1.0", "0.7"]
    desk.answer()
    desk.clock.advance(RETRANSMIT_S)
    desk.rover.point_camera(CameraIntent(0.7, 0.1, 1.0, MOE8))
    assert desk.commands[4:] == ["SET_CAMERA_ANGLES"]


def test_a_speed_is_set_again_for_the_next_command(desk: Desk) -> None:
    desk.rover.execute_motion(LINE)
    desk.answer()
    desk.answer()
    desk.rover.execute_motion(replace(LINE, number=2, command=MOE8))
    assert desk.commands == ["SET_TRAVEL_SPEED", "MOVE_FORWARD", "SET_TRAVEL_SPEED"]


def test_a_request_for_a_command_carries_its_number_and_counts(desk: Desk) -> None:
    desk.rover.execute_motion(LINE)
    desk.answer()
    desk.rover.halt()
    sent = [(m.source, m.moe_inputs_id, m.moe_inputs_counter) for m in desk.sent]
    assert sent[:2] == [("MOE", 7, 1), ("MOE", 7, 2)]
    assert sent[2][0] == "EXEC"
    assert sent[2][2] is None


def test_a_motion_that_waits_for_its_speed_ends_as_it_ended_by_the_other_link(desk: Desk) -> None:
    desk.rover.execute_motion(LINE)
    whole = replace(desk.sent[-1], moe_inputs_counter=None)
    desk.rover.on_reply(reply(whole, True, True, "EXECUTED"))
    assert desk.ended == [
        MotionEnded(1, True, "EXECUTED"),
        ExternalCommandEnded(MOE7, True, "EXECUTED"),
    ]


@pytest.mark.parametrize("executed", [True, False])
def test_a_command_received_by_the_other_link_first_ends_as_it_ended_there(
    desk: Desk, executed: bool
) -> None:
    desk.rover.execute_motion(LINE)
    desk.answer()
    whole = replace(desk.sent[-1], moe_inputs_counter=None)
    desk.rover.on_reply(reply(whole, False, True, "STARTED"))
    assert desk.ended == [ExternalCommandRunning(MOE7)]
    desk.ended.clear()
    desk.rover.on_reply(reply(whole, executed, True, "EXECUTED" if executed else "FAILED"))
    why = "EXECUTED" if executed else "FAILED"
    assert desk.ended == [MotionEnded(1, executed, why), ExternalCommandEnded(MOE7, executed, why)]
    desk.rover.execute_motion(replace(TURN, command=MOE8))
    assert desk.commands[-1] == "SET_ROTATE_SPEED"


@given(st.lists(st.sampled_from(["line", "turn", "halt", "camera", "reply", "refuse"])))
def test_one_request_is_active_at_a_time_for_any_input(acts: list[str]) -> None:
    desk, begun, unanswered = Desk(), 0, 0
    for act in acts:
        before = len(desk.sent)
        match act:
            case "line" | "turn":
                begun += 1
                what = LINE.primitive if act == "line" else TURN.primitive
                desk.rover.execute_motion(DelegatedMotion(begun, what, MOE7))
            case "halt":
                desk.rover.halt()
                assert desk.sent[-1].command == "STOP"
                unanswered = 0
            case "camera":
                desk.rover.point_camera(CameraIntent(0.1 * len(desk.sent), 0.0, 1.0, MOE8))
            case _:
                if unanswered:
                    unanswered -= 1
                    desk.answer(act == "reply", True, "" if act == "reply" else "FAILED")
        unanswered += len(desk.sent) - before
        assert unanswered <= 1
    numbers = [(m.source, m.moe_inputs_id, m.moe_inputs_counter) for m in desk.sent]
    assert len(set(numbers)) == len(numbers)
    ends = [ended.number for ended in desk.ended if isinstance(ended, MotionEnded)]
    assert len(set(ends)) == len(ends)


def test_the_next_process_uses_other_numbers(desk: Desk) -> None:
    later = Desk()
    later.clock.advance(0.001)
    later.rover = MocupRover(
        DICTIONARY, later.clock, later.sent.append, later.ended.append, "EXEC", "MOCUP"
    )
    for _ in range(100):
        desk.rover.halt()
        later.rover.halt()
    numbers = {message.moe_inputs_id for message in (*desk.sent, *later.sent)}
    assert len(numbers) == 200


@pytest.mark.parametrize("source", ["Mission control", "a|b", "\N{SNOWMAN}", "M" * 5000])
def test_a_command_with_an_unencodable_source_is_executed(desk: Desk, source: str) -> None:
    desk.rover.execute_motion(replace(LINE, command=Identity(source, 7)))
    desk.answer()
    desk.answer()
    assert desk.commands == ["SET_TRAVEL_SPEED", "MOVE_FORWARD"]
    assert {message.source for message in desk.sent} == {"EXEC"}
    assert desk.ended == [MotionEnded(1, True, "")]


def test_a_motion_does_not_begin_at_a_speed_that_the_brick_did_not_take(desk: Desk) -> None:
    desk.rover.execute_motion(LINE)
    desk.rover.execute_motion(replace(TURN, command=MOE8))
    desk.answer(False, False, "REJECTED", "QUEUE_FULL", "BUSY")
    assert desk.commands == ["SET_TRAVEL_SPEED", "SET_ROTATE_SPEED"]
    assert desk.ended == [MotionEnded(1, False, "REJECTED QUEUE_FULL BUSY")]
    desk.answer()
    assert desk.commands[2:] == ["ROTATE_BY"]


def test_an_unanswered_request_is_forgotten_after_many_others(desk: Desk) -> None:
    desk.rover.execute_motion(HOLD)
    for _ in range(MAX_PENDING):
        assert desk.rover.moving
        desk.rover.halt()
    assert not desk.rover.moving
