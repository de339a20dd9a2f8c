"""What every bench is run with: a table, a file of figures, an exit status."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from sim.bench.figures import Figure

Measure = Callable[[], "list[Figure]"]

JSON = click.option(
    "--json",
    "json_path",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Write every figure with unit, comparison and goal to a JSON file.",
)


def run(measures: list[Measure], json_path: Path | None) -> None:
    """Measure, print a table, write figures, and end with 1 where a goal is missed."""
    from rich.console import Console

    from executive.settings import SettingsError
    from sim.bench.figures import write_json
    from sim.bench.table import table

    if json_path is not None and not json_path.parent.is_dir():
        raise click.UsageError(f"--json: there is no folder {json_path.parent}")
    figures = []
    for measure in measures:
        try:
            figures += measure()
        except SettingsError as error:
            raise click.UsageError(str(error)) from error
    Console().print(table(figures))
    if json_path is not None:
        write_json(figures, json_path)
        click.echo(f"figures written to {json_path}")
    missed = [figure.name for figure in figures if figure.met is False]
    if missed:
        click.echo(f"goals missed: {', '.join(missed)}")
        raise click.exceptions.Exit(1)
