"""The priority of a process: raised where that is permitted, and left as it was chosen."""

import os
import sys

import pytest

from tests.support.processes import run_to_end

SHOWN = "; import os; print(os.getpriority(os.PRIO_PROCESS, 0))"
TAKEN = """import logging; logging.basicConfig(level="INFO")
from adapters.process import take_priority; take_priority()"""
WITHOUT_PERMISSION = "import os, adapters.process; os.seteuid(65534)\n"
as_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root may raise a priority")


@as_root
def test_it_is_raised() -> None:
    assert run_to_end(sys.executable, "-c", TAKEN + SHOWN).stdout == "-10\n"


@as_root
def test_without_permission_it_remains_and_is_logged() -> None:
    done = run_to_end(sys.executable, "-c", WITHOUT_PERMISSION + TAKEN + SHOWN)
    assert done.stdout == "0\n"
    assert "priority not raised to nice -10: not permitted" in done.stderr


def test_a_priority_set_outside_remains() -> None:
    assert run_to_end("nice", "-n", "3", sys.executable, "-c", TAKEN + SHOWN).stdout == "3\n"
