from dataclasses import replace

from adapters.mops.codec import Message
from adapters.mops.reports import refusal_of
from adapters.relay.rover.replies import Replies
from executive.commands.catalogue import SetTravelSpeed
from executive.reports import Identity
from tests.relay.rover.test_tray import DICTIONARY, event


def command(number: int) -> Message:
    return DICTIONARY.command(SetTravelSpeed(0.25), Identity("MOE", number), "JACKAL")


def reply(number: int) -> Message:
    return refusal_of(command(number), "JACKAL", "no")


def test_commands_are_answered_when_something_was_said_on_each() -> None:
    replies = Replies()
    replies.begin([command(1), command(2)])
    replies.holds(reply(3))
    replies.holds(reply(1))
    assert not replies.answered()
    replies.holds(reply(2))
    assert replies.answered()


def test_what_is_said_on_a_command_waits_until_it_is_delivered_and_all_after_it() -> None:
    replies = Replies()
    replies.begin([command(1)])
    said = [event(1), reply(1), event(2), reply(7)]
    assert [replies.holds(each) for each in said] == [False, True, True, True]
    assert replies.end() == said[1:]
    assert not replies.holds(reply(1))
    assert replies.end() == []


def test_what_is_awaited_is_what_nothing_was_said_on() -> None:
    replies = Replies()
    replies.begin([command(1), command(2)])
    replies.holds(reply(1))
    assert replies.awaited() == [command(2)]


def test_a_command_without_a_number_is_not_answered_by_what_is_said_on_another() -> None:
    bare = [replace(command(1), moe_inputs_id=None), replace(command(2), moe_inputs_id=None)]
    replies = Replies()
    replies.begin(bare)
    assert replies.holds(refusal_of(bare[0], "JACKAL", "no"))
    assert not replies.answered()
    assert replies.awaited() == bare
