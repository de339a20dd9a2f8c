"""The log of a process: one line an event, whatever peers put into texts."""

import logging
from collections.abc import Iterator

import pytest

from adapters.process import log_to_stderr

FORGED = "moved\n2026-11-22T12:00:00.000Z INFO    MOE:1 EXECUTED\x1b[2J\0\u2028"


@pytest.fixture(autouse=True)
def _restored() -> Iterator[None]:
    root = logging.getLogger()
    before = root.level, root.handlers[:]
    yield
    root.level, root.handlers = before


def test_no_text_makes_a_line_of_its_own(capsys: pytest.CaptureFixture[str]) -> None:
    log_to_stderr("info")
    logging.getLogger("any").warning("%s", FORGED)
    try:
        raise ValueError(FORGED)
    except ValueError:
        logging.getLogger("any").exception("it broke")
    first, second, *traceback = capsys.readouterr().err.splitlines()
    assert first.endswith(
        "Z WARNING moved\\n2026-11-22T12:00:00.000Z INFO    MOE:1 EXECUTED\\x1b[2J\\x00\\u2028"
    )
    assert second.endswith("Z ERROR   it broke")
    assert all(line.startswith("  ") and line.isprintable() for line in traceback)
