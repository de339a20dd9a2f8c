"""Open questions of plans as a message: values, omissions, refusals."""

from dataclasses import replace

import pytest

from adapters.mops import (
    Message,
    MopsError,
    OpenQuestions,
    decode,
    encode,
    load_dictionary,
    questions_message,
    questions_of,
)
from executive.values.plan_nodes import Question

ENTRY = load_dictionary().spelling.questions
DITCH = Question("day/ditch", "Cross, or|back #1?", ("cross", "turn back"), "cross", 1796000000.5)
OPEN_ENDED = Question("day/ö", "Weiter?", ("ja", "nein"), None, None)


def message_of(*questions: Question) -> Message:
    return questions_message({"day": questions}, 1795990000.0, ENTRY, "JACKAL")


def test_all_open_questions_return_from_their_octets() -> None:
    message = decode(encode(message_of(DITCH, OPEN_ENDED)))
    assert (message.code, message.command, message.dest) == (0x306, "QUESTIONS", "ALL")
    assert questions_of(message, ENTRY) == OpenQuestions(
        1795990000.0, (("day", DITCH), ("day", OPEN_ENDED))
    )
    assert questions_of(message_of(), ENTRY) == OpenQuestions(1795990000.0)


def test_texts_are_cut_and_questions_omitted_before_options_are() -> None:
    long = replace(DITCH, text="ü" * 600)
    shown = questions_of(message_of(long), ENTRY)
    assert len(shown.questions[0][1].text) == 250
    shown = questions_of(message_of(*[long] * 8), ENTRY)
    assert (len(shown.questions), shown.more) == (8, 0)
    assert {len(each.text) for _, each in shown.questions} == {40}
    shown = questions_of(decode(encode(message_of(*[long] * 30))), ENTRY)
    assert len(shown.questions) + shown.more == 30
    assert len(shown.questions) > 8
    assert shown.questions[0][1].options == DITCH.options


@pytest.mark.parametrize(
    ("outputs", "text"),
    [
        ((), "utc_s is missing"),
        (("1.0", "0", "day", "key"), "text is missing"),
        (("1.0", "0", "day", "key", "Go?", "a;b", "", "noon"), "until_utc_s: 'noon' is no"),
        (("-1.0", "0"), "utc_s"),
    ],
)
def test_other_values_are_refused(outputs: tuple[str, ...], text: str) -> None:
    with pytest.raises(MopsError, match=text):
        questions_of(replace(message_of(), outputs=outputs), ENTRY)
    with pytest.raises(MopsError, match="has no questions"):
        questions_of(replace(message_of(), code=0x305), ENTRY)
