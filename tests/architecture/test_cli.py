"""The `rover` command itself: lazy, and with exit codes that mean something."""

import errno
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import click
import pytest
from click.testing import CliRunner, Result

from adapters.cli import main as cli

CHECKOUT = Path(__file__).resolve().parents[2]
IMPORTED = """
import sys
from click.testing import CliRunner
from adapters.cli.main import main
result = CliRunner().invoke(main, sys.argv[1:])
print(result.exit_code, *(name for name in {names} if name in sys.modules))
"""


def imported(names: list[str], *arguments: str) -> list[str]:
    """Run the command in a fresh interpreter; return its exit code and which names it imported."""
    program = [sys.executable, "-c", IMPORTED.format(names=names), *arguments]
    return subprocess.run(program, check=True, capture_output=True, text=True).stdout.split()


Run = Callable[[BaseException], Result]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Run:
    """Return a way to run `rover probe`, a command that ends with a given error."""

    def call(error: BaseException) -> Result:
        @click.command()
        def probe() -> None:
            raise error

        monkeypatch.setattr(cli.EntryPointGroup, "get_command", lambda *_: probe)
        return CliRunner().invoke(cli.main, ["probe"])

    return call


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (click.ClickException("it ended FAILED"), 1),
        (click.UsageError("no such file"), 2),
        (ConnectionRefusedError("127.0.0.1:4001"), 3),
        (TimeoutError("no answer in 5 s"), 3),
        (BrokenPipeError("127.0.0.1:4001"), 3),
        (OSError(errno.ENOSPC, "No space left on device", "run.mcap"), 1),
        (KeyboardInterrupt(), 130),
    ],
)
def test_exit_code_reports_the_kind_of_end(run: Run, error: BaseException, code: int) -> None:
    result = run(error)
    assert result.exit_code == code
    message = error.strerror if isinstance(error, OSError) else None
    assert (message or str(error)) in result.output
    assert "Traceback" not in result.output


def test_a_fault_is_not_hidden(run: Run) -> None:
    assert isinstance(run(ZeroDivisionError()).exception, ZeroDivisionError)


@pytest.mark.parametrize(
    ("typed", "message"),
    [("fly", "No such command 'fly'."), ("comand", "Did you mean 'command'?")],
)
def test_unknown_command_is_a_usage_error(typed: str, message: str) -> None:
    result = CliRunner().invoke(cli.main, [typed])
    assert result.exit_code == 2
    assert message in result.output


def test_a_command_imports_no_other() -> None:
    others = ["tests.suite", "adapters.mrs", "trees", "sim", "executive"]
    assert imported(others, "completion", "--help") == ["0"]


def test_help_lists_every_command_and_imports_no_package() -> None:
    packages = ["executive", "trees", "sim", "adapters.mal", "adapters.mrs", "adapters.bundle"]
    assert imported(packages, "--help") == ["0"]
    listed = CliRunner().invoke(cli.main, ["--help"]).output
    names = "bench command demo mal scenario status test tree video watch"
    for name in names.split():
        assert re.search(rf"\n  {name} +[A-Z]", listed)


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_prints_the_completion_script(shell: str) -> None:
    result = CliRunner().invoke(cli.main, ["completion", shell])
    assert result.exit_code == 0
    assert "_ROVER_COMPLETE" in result.output


PROCESS = """
import asyncio
from adapters.process import process
async def prints():
    print('x', flush=True)
async def serves():
    async with asyncio.TaskGroup() as tasks:
        tasks.create_task(prints())
        tasks.create_task(asyncio.sleep(0.1))
@process('rover-x', ros=False)
def main():
    asyncio.run(serves())
main()
"""
PROGRAMS = {
    "help": "from adapters.cli.main import main; main(['--help'])",
    "click": "from adapters.cli.main import main; main(['mal', 'check', 'tests/mal/vectors.json'])",
    "rich": "from adapters.cli.main import main; main(['scenario', '{scenario}'])",
    "process": PROCESS,
}
SCENARIO = """
title: A title with the signs ± → ✓ and ü
duration: 1
timeline: [{at: 0.1, command: stop, label: halt}]
expect:
  - {command: halt, stages: [RECEIVED, ACCEPTED, STARTED, EXECUTED]}
  - {pose: {x: 0, y: 0, heading: 0}, tolerance: 0.05, after: halt EXECUTED}
"""


@pytest.fixture(params=list(PROGRAMS))
def program(request: pytest.FixtureRequest, tmp_path: Path) -> list[str]:
    """Return a command line that prints by click, by rich, or by itself."""
    return _program(PROGRAMS[request.param], tmp_path)


def _program(text: str, folder: Path) -> list[str]:
    path = folder / "signs.yaml"
    path.write_text(SCENARIO, encoding="utf-8")
    return [sys.executable, "-c", text.replace("{scenario}", str(path))]


def test_a_closed_output_ends_it_quietly(program: list[str]) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    with open(writer, "wb") as closed:
        ended = subprocess.run(program, stdout=closed, stderr=subprocess.PIPE, cwd=CHECKOUT)
    assert (ended.returncode, ended.stderr.decode()) == (141, "")


def test_a_full_disk_is_one_line(program: list[str]) -> None:
    with open("/dev/full", "wb") as full:
        ended = subprocess.run(program, stdout=full, stderr=subprocess.PIPE, cwd=CHECKOUT)
    message = "Error: output cannot be written: No space left on device\n"
    assert (ended.returncode, ended.stderr.decode()) == (1, message)


def test_a_closed_output_is_none(program: list[str]) -> None:
    shell = ["sh", "-c", 'exec "$@" >&-', "sh", *program]
    ended = subprocess.run(shell, stderr=subprocess.PIPE, cwd=CHECKOUT)
    assert (ended.returncode, ended.stderr.decode()) == (0, "")


@pytest.mark.parametrize("encoding", ["ascii", "iso-8859-1"])
@pytest.mark.parametrize("arguments", [["scenario", "{scenario}"], ["tree"]], ids=str)
def test_a_terminal_without_utf_8_is_written_to(
    arguments: list[str], encoding: str, tmp_path: Path
) -> None:
    program = _program(f"from adapters.cli.main import main; main({arguments})", tmp_path)
    variables = {**os.environ, "PYTHONIOENCODING": encoding}
    ended = subprocess.run(program, capture_output=True, cwd=CHECKOUT, env=variables)
    assert (ended.returncode, ended.stderr.decode()) == (0, "")
    assert ended.stdout


def test_each_glyph_of_the_product_is_spelled_out_if_it_is_missing() -> None:
    sources = (
        path.read_text(encoding="utf-8")
        for package in ("executive", "trees", "adapters", "sim")
        for path in (CHECKOUT / package).rglob("*.py")
    )
    signs = {sign for text in sources for sign in text if not sign.isascii()}
    assert {"±", "°", "✓", "│"} <= signs
    spelled = {sign: sign.encode("ascii", "rover.plain").decode() for sign in signs}
    assert {sign for sign, text in spelled.items() if text == "?"} == {"⁶"}, "of a comment"
