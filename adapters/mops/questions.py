"""Converts the open questions of plans to a MOPS message, and back."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from adapters.mops.codec import (
    MAX_UTC_S,
    Message,
    MopsError,
    from_values,
    require_within,
    values_of,
)
from adapters.mops.dictionary import OtherEntry
from adapters.mops.reports import TO_ALL, cut
from executive.values.plan_nodes import Question

SHORT_TEXT_LENGTH: Final = 40
"""Length of the texts of questions if the message is too long otherwise."""
_SEPARATOR: Final = ";"
"""Between options, as in the text of a plan."""


@dataclass(frozen=True, slots=True)
class _QuestionValues:
    """The values of a question in a message."""

    plan: str
    key: str
    text: str
    options: str
    default: str | None
    until_utc_s: float | None


@dataclass(frozen=True, slots=True)
class _Questions:
    utc_s: float
    more: int
    questions: tuple[_QuestionValues, ...]


@dataclass(frozen=True, slots=True)
class OpenQuestions:
    """The open questions of an asset.

    Attributes:
        utc_s: time of the message, seconds since 1970-01-01 UTC.
        questions: each with the id of its plan.
        more: number of further open questions: the message has no space for them.
    """

    utc_s: float
    questions: tuple[tuple[str, Question], ...] = ()
    more: int = 0


def questions_message(
    questions: Mapping[str, Sequence[Question]], utc_s: float, entry: OtherEntry, source: str
) -> Message:
    """Return the message that carries all open questions, by the ids of their plans.

    Texts are cut and questions omitted as far as the message would be too long.

    Raises:
        MopsError: a value cannot be encoded.
    """
    values = tuple(_values(plan_id, each) for plan_id, some in questions.items() for each in some)
    message = _message(values, 0, utc_s, entry, source)
    short = tuple(replace(each, text=cut(each.text, SHORT_TEXT_LENGTH)) for each in values)
    for count in range(len(values), -1, -1):
        if _fits(message):
            break
        message = _message(short[:count], len(values) - count, utc_s, entry, source)
    return message


def _values(plan_id: str, question: Question) -> _QuestionValues:
    options = _SEPARATOR.join(question.options)
    return _QuestionValues(
        plan_id, question.key, cut(question.text), options, question.default, question.until_utc_s
    )


def _message(
    values: tuple[_QuestionValues, ...], more: int, utc_s: float, entry: OtherEntry, source: str
) -> Message:
    outputs = tuple(values_of(_Questions(utc_s, more, values)))
    return Message(entry.code, source, TO_ALL, entry.command, outputs=outputs, received=True)


def _fits(message: Message) -> bool:
    try:
        return bool(str(message))
    except MopsError:
        return False


def questions_of(message: Message, entry: OtherEntry) -> OpenQuestions:
    """Return the open questions that a message carries.

    Raises:
        MopsError: it is no such message, or a value is invalid.
    """
    if (message.code, message.command) != (entry.code, entry.command) or message.inputs:
        raise MopsError(f"{message.code:03X} {message.command} has no questions")
    found: _Questions = from_values(_Questions, message.outputs)
    require_within("utc_s", found.utc_s, 0, MAX_UTC_S)
    for each in found.questions:
        require_within("until_utc_s", each.until_utc_s, 0, MAX_UTC_S)
    return OpenQuestions(
        found.utc_s, tuple((each.plan, _question(each)) for each in found.questions), found.more
    )


def _question(values: _QuestionValues) -> Question:
    options = tuple(values.options.split(_SEPARATOR))
    return Question(values.key, values.text, options, values.default, values.until_utc_s)
