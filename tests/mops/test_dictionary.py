from dataclasses import replace
from math import inf, nan
from pathlib import Path
from typing import Any, get_args

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from adapters.mops import (
    CommandConditions,
    Message,
    MopsError,
    conditions_of,
    decode,
    encode,
    load_dictionary,
    mark_overtaken,
)
from executive.commands import (
    DeleteFile,
    ExecuteAction,
    FollowPath,
    MoveForward,
    MoveTo,
    Precondition,
    Request,
    Stop,
    Waypoint,
    all_declarations,
)
from executive.settings import Controller, SettingsError
from executive.values.parameters import Parameter
from executive.values.reports import Identity
from tests.support.preconditions import PRECONDITIONS

DICTIONARY = load_dictionary()
MOE = Identity("MOE", 7)
FLOATS = st.floats(allow_nan=False, allow_infinity=False)
st.register_type_strategy(float, FLOATS)
REQUESTS = st.one_of(*(st.from_type(kind) for kind in get_args(Request)))


def test_every_command_is_spelled() -> None:
    assert set(DICTIONARY.commands) == {each.name for each in all_declarations()}


def spelled(request: Request) -> Message:
    return DICTIONARY.command(request, MOE, "MOCUP")


@given(REQUESTS)
def test_every_request_survives_the_round_trip(request: Request) -> None:
    try:
        octets = encode(spelled(request))
    except MopsError as fault:
        known = ("at most", "one empty value", "would be read as none", "do not carry it")
        assume(not any(each in str(fault) for each in known))
        raise
    assert DICTIONARY.request(decode(octets)) == request


@given(PRECONDITIONS, st.booleans())
def test_conditions_survive_the_round_trip_and_a_mark(only: Precondition, timed: bool) -> None:
    first = CommandConditions(3, 1.5e9, 60.0) if timed else CommandConditions()
    at, after, mode = only.wire_values
    made = replace(first, only_at=at, only_after=after, only_mode=mode)
    message = decode(encode(DICTIONARY.command(MoveForward(1.0), MOE, "MOCUP", made)))
    assert conditions_of(message) == made
    assert conditions_of(message).precondition == (only or None)
    marked = decode(encode(mark_overtaken(message)))
    assert conditions_of(marked) == replace(made, overtaken=True)


@pytest.mark.parametrize("only", [("1 2", None, None), (None, 0, None), (None, None, "IDL")])
def test_a_precondition_that_cannot_be_read_is_refused(only: tuple[Any, Any, Any]) -> None:
    made = CommandConditions(None, None, None, None, *only)
    with pytest.raises(MopsError, match="precondition: "):
        conditions_of(DICTIONARY.command(MoveForward(1.0), MOE, "MOCUP", made))


@pytest.mark.parametrize(
    ("request_", "text"),
    [
        (Stop(), "10E|MOE|MOCUP|STOP|||False|False|7|#"),
        (
            MoveTo(Waypoint(1.0, 2.5, None, 0.1)),
            "101|MOE|MOCUP|MOVE_TO|1.0,2.5,,0.1||False|False|7|#",
        ),
        (
            FollowPath((Waypoint(1.0, 2.0), Waypoint(3.0, 4.0, 1.0))),
            "106|MOE|MOCUP|FOLLOW_PATH|1.0,2.0,,,3.0,4.0,1.0,||False|False|7|#",
        ),
        (ExecuteAction("A, B|#%"), "143|MOE|MOCUP|EXECUTE_ACTION|A%2C B%7C%23%25||False|False|7|#"),
    ],
)
def test_commands_read_so(request_: Request, text: str) -> None:
    assert str(spelled(request_)) == text


@pytest.mark.parametrize(
    ("message", "fault"),
    [
        (replace(spelled(Stop()), code=0x1FF), "1FF is no command"),
        (replace(spelled(Stop()), command="HALT"), "is STOP, not HALT"),
        (replace(spelled(Stop()), inputs=("1",)), "1 too many"),
        (replace(spelled(MoveForward(1.0)), inputs=()), "distance_m is missing"),
        (replace(spelled(MoveForward(1.0)), inputs=("1", "2")), "1 too many"),
        (replace(spelled(MoveForward(1.0)), inputs=("nan",)), "'nan' is no number"),
        (replace(spelled(MoveForward(1.0)), inputs=("1e999",)), "is no number"),
        (replace(spelled(MoveForward(1.0)), inputs=("1_0",)), "is no number"),
        (replace(spelled(MoveForward(1.0)), inputs=(" 1",)), "is no number"),
        (replace(spelled(DeleteFile("a")), inputs=("%zz",)), "percent-encoded"),
        (replace(spelled(DeleteFile("a")), inputs=("%ff",)), "UTF-8"),
        (replace(spelled(FollowPath((Waypoint(1, 2),))), inputs=("1", "2", "")), "tolerance_m"),
    ],
)
def test_what_does_not_fit_is_named(message: Message, fault: str) -> None:
    with pytest.raises(MopsError, match=fault):
        DICTIONARY.request(message)


@pytest.mark.parametrize(
    "request_",
    [
        MoveTo(Waypoint(1.0, 2.0), Controller.TURN_DRIVE),
        FollowPath((Waypoint(1.0, 2.0),), Controller.MPC),
    ],
)
def test_a_controller_is_not_lost_in_transmission(request_: Request) -> None:
    with pytest.raises(MopsError, match="controller: messages do not carry it"):
        spelled(request_)


@pytest.mark.parametrize("value", [nan, inf, -inf])
def test_an_invalid_number_is_not_sent(value: float) -> None:
    with pytest.raises(MopsError, match="distance_m"):
        spelled(MoveForward(value))


@given(st.builds(Message, st.integers(0, 0xFFF), st.just("MOE"), st.just("MOCUP"), st.text(),
                 st.lists(st.text(max_size=8)).map(tuple)))  # fmt: skip
def test_no_message_upsets_it(message: Message) -> None:
    known = DICTIONARY.commands["moveTo"]
    for tried in (message, replace(message, code=known.code, command=known.command)):
        try:
            DICTIONARY.request(tried)
        except MopsError:
            continue


def test_telemetry_holds_all_parameters() -> None:
    assert set(DICTIONARY.spelling.telemetry.outputs) == set(Parameter)


@pytest.mark.parametrize(
    ("changed", "fault"),
    [
        (("moveForward:", "jump:"), "there is no command jump"),
        (("drive:", "driveFor:"), "there is no command driveFor"),
        (("moveForward: 0x102", "moveForward: {code: 0x102}"), "commands"),
        (("0x103", "0x102"), "commands.rotateTo has the code 0x102, as commands.moveForward"),
        (("code: 0x301", "code: 0x101"), "telemetry has the code 0x101, as commands.moveTo"),
        (("code: 0x201", "code: 0x301"), "event has the code 0x301, as telemetry"),
        (("code: 0x302", "code: 0x201"), "link has the code 0x201, as event"),
        (("0x101", "0x1000"), "commands.moveTo has the code 0x1000: "),
        (("code: 0x302", "code: -1"), "link has the code -0x1: "),
        (("command: EVENT", "command: E|VENT"), r"event.command is 'E\|VENT': "),
        (("command: EVENT", "command: ''"), "event.command is '': "),
        (("command: EVENT", "command: HALT THERE"), "event.command is 'HALT THERE': "),
        (("command: LINK", "command: STOP"), "link has the command STOP, as commands.stop"),
        (("POS_X", "POS_W"), r"telemetry.outputs\[0\]"),
        (("[POS_X, POS_Y", "[POS_X, POS_X, POS_Y"), "telemetry.outputs has POS_X twice"),
        (("[POS_X, POS_Y", "[POS_X"), "telemetry.outputs lacks POS_Y"),
        (("  stop: 0x10E\n", ""), "commands lacks stop"),
    ],
)
def test_a_file_that_does_not_fit_is_refused(
    tmp_path: Path, changed: tuple[str, str], fault: str
) -> None:
    text = (Path(__file__).parents[2] / "config" / "mops" / "dictionary.yaml").read_text()
    assert changed[0] in text
    path = tmp_path / "mops.yaml"
    path.write_text(text.replace(*changed))
    with pytest.raises(SettingsError, match=fault) as caught:
        load_dictionary(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
