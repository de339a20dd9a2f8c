"""The types by which the pages are checked are those of what the server sends."""

from tests.console.message_types import FILE, message_types


def test_the_types_of_the_pages_are_written_from_the_messages() -> None:
    assert FILE.read_text(encoding="utf-8") == message_types()
