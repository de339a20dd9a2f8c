"""`rover test`: every check that a change must pass, one after the other."""

import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import click

CHECKOUT: Final = Path(__file__).resolve().parents[2]
CORE: Final = "executive/*,trees/*"
CORE_PERCENT: Final = "95"
WORKERS: Final = ("-n", "2", "--dist", "loadfile")


@dataclass(frozen=True, slots=True)
class Check:
    """Programs to run in the checkout one after the other; passed where all exit 0."""

    name: str
    commands: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a check ended, and how long it took."""

    name: str
    passed: bool
    took_s: float


def _python(*arguments: str) -> tuple[str, ...]:
    return (sys.executable, "-m", *arguments)


CHECKS: Final = (
    Check("ruff check", (_python("ruff", "check", "."),)),
    Check("ruff format", (_python("ruff", "format", "--check", "."),)),
    Check("mypy", (_python("mypy"),)),
    Check("import contracts", ((str(Path(sys.executable).with_name("lint-imports")),),)),
    Check(
        "pytest",
        (
            _python("coverage", "erase"),
            _python("coverage", "run", "-m", "pytest", "-m", "not ros", *WORKERS),
        ),
    ),
    # Alone, because in real time: beside another worker odometry can come too late to drive by.
    Check("pytest, ros", (_python("coverage", "run", "-m", "pytest", "-m", "ros"),)),
    Check(
        "coverage",
        (
            _python("coverage", "combine", "--quiet"),
            _python("coverage", "report"),
            _python("coverage", "report", "--include", CORE, "--fail-under", CORE_PERCENT),
        ),
    ),
)


@click.command(context_settings={"ignore_unknown_options": True})
@click.argument("pytest_arguments", nargs=-1, type=click.UNPROCESSED)
def test(pytest_arguments: tuple[str, ...]) -> None:
    """Run all checks of this checkout, or only some tests.

    Without arguments: style, types, import contracts, the whole test suite and its coverage. With
    arguments: pytest alone, with these; paths start at the top of the checkout.

    \b
    Examples:
      rover test
      rover test tests/mal
      rover test -k duplicate -x
    """
    if not (CHECKOUT / "tests").is_dir():
        raise click.UsageError("rover test needs a checkout of the repository; this is an install")
    if pytest_arguments:
        sys.exit(_run(_python("pytest", *pytest_arguments)))
    outcomes = [_carry_out(check) for check in CHECKS]
    _summarize(outcomes)
    sys.exit(any(not outcome.passed for outcome in outcomes))


def _run(command: tuple[str, ...]) -> int:
    return subprocess.run(command, cwd=CHECKOUT, check=False).returncode


def _carry_out(check: Check) -> Outcome:
    click.secho(f"── {check.name} ".ljust(72, "─"), bold=True)
    began_s = time.monotonic()
    passed = all(_run(command) == 0 for command in check.commands)
    return Outcome(check.name, passed, time.monotonic() - began_s)


def _summarize(outcomes: list[Outcome]) -> None:
    click.secho("── summary ".ljust(72, "─"), bold=True)
    for outcome in outcomes:
        word, colour = ("passed", "green") if outcome.passed else ("FAILED", "red")
        click.echo(f"{outcome.name:<18}{click.style(word, fg=colour)}{outcome.took_s:>9.1f} s")
