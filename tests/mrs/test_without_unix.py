"""The ground's side where Python lacks what only Unix has, as on Windows.

It is hidden in another process, which commands a rover of this one.
"""

import subprocess
import sys

from tests.mrs.aboard import Aboard

HIDDEN = """
import asyncio, os, signal, sys

sys.modules |= dict.fromkeys(("fcntl", "grp", "pty", "pwd", "resource", "termios", "tty"))
for name in ("SIGHUP", "SIGKILL", "SIGPIPE", "SIGQUIT", "SIGUSR1", "SIGUSR2"):
    delattr(signal, name)
for name in ("fork", "geteuid", "getuid", "killpg", "sched_getaffinity", "statvfs", "sysconf"):
    delattr(os, name)

def unavailable(*_):
    raise NotImplementedError

for name in ("add_reader", "add_signal_handler", "add_writer"):
    setattr(asyncio.SelectorEventLoop, name, unavailable)
"""
FROM_PYTHON = """
from adapters.api import BlockingClient, MoveForward, MrsClient

with BlockingClient(sys.argv[1]) as rover:
    print(rover.run(MoveForward(1.0)).stage.name, round(rover.call(MrsClient.get_pose).x, 1))
"""
TYPED = "from adapters.cli.main import main; main(sys.argv[1:])"


def run(code: str, *arguments: str) -> str:
    done = subprocess.run(
        [sys.executable, "-c", HIDDEN + code, *arguments],
        capture_output=True,
        text=True,
        check=False,
        timeout=60.0,
    )
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


def test_the_python_client_commands_a_rover(running: Aboard) -> None:
    assert run(FROM_PYTHON, running.uri) == "EXECUTED 1.0\n"


def test_a_typed_command_reaches_a_rover(running: Aboard) -> None:
    def typed(name: str, *arguments: str) -> str:
        return run(TYPED, name, "--to", running.uri, *arguments)

    assert "EXECUTED" in typed("command", "moveForward", "1")
    assert "battery" in typed("status")
    assert "state of the rover" in typed("why")
    assert "moveForward: accepted" in typed("log")
    assert "octets" in run(TYPED, "files", "list", "--to", running.uri)
