"""`benchmark` makes a function a command of `rover bench`: its options, its table of figures."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

if TYPE_CHECKING:
    from tests.support.figures import Figure

Measure = Callable[..., "list[Figure]"]
JSON: Final = click.option(
    "--json",
    "json_path",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Write every figure with unit, comparison and goal to a JSON file.",
)
SEED: Final = click.option("--seed", type=int, default=1, show_default=True)
OUTPUT: Final = click.option(
    "--keep",
    "folder",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    help="An empty folder for journals, records and logs.  [default: they are deleted]",
)
MEASURES: dict[str, Measure] = {}
COMMANDS: dict[str, click.Command] = {}
"""Both by the names of the benchmarks."""


def count(name: str, default: int, least: int = 1) -> Callable[[Any], Any]:
    """Return an option that says how many."""
    return click.option(name, "count", type=click.IntRange(least), default=default,
                        show_default=True)  # fmt: skip


def run(measures: list[Measure], json_path: Path | None) -> None:
    """Measure, print a table, write figures, and end with 1 where a goal is missed."""
    from rich.console import Console

    from executive.settings import SettingsError
    from sim.processes import AddressError, ChildError
    from tests.support.figures import table, write_json

    if json_path is not None and not json_path.parent.is_dir():
        raise click.UsageError(f"--json: there is no folder {json_path.parent}")
    figures = []
    for measure in measures:
        try:
            figures += measure()
        except SettingsError as error:
            raise click.UsageError(str(error)) from error
        except (ChildError, ChildProcessError, AddressError, TimeoutError) as error:
            raise click.ClickException(str(error)) from error
    Console().print(table(figures))
    if json_path is not None:
        write_json(figures, json_path)
        click.echo(f"figures written to {json_path}")
    missed = [figure.name for figure in figures if figure.met is False]
    if missed:
        click.echo(f"goals missed: {', '.join(missed)}")
        raise click.exceptions.Exit(1)


def benchmark(example: str, *options: Callable[[Any], Any]) -> Callable[[Measure], Measure]:
    """Have a function be a sub-command, by its name, documentation and options."""

    def declare(measure: Measure) -> Measure:
        def command(json_path: Path | None, **chosen: Any) -> None:
            run([partial(measure, **chosen)], json_path)

        name = measure.__name__.replace("_", "-")
        MEASURES[name] = measure
        for option in (*reversed(options), JSON):
            command = option(command)
        made = click.command(name, help=measure.__doc__, epilog=f"Example: rover bench {example}")
        COMMANDS[name] = made(command)
        return measure

    return declare


def log(line: str) -> None:
    """Say how it goes on, beside the figures."""
    click.echo(line, err=True)
