"""Every command's help has an example, as the front page promises."""

from collections.abc import Iterator

import click
import pytest
from click.testing import CliRunner

from adapters.cli.main import main


def commands(command: click.Command, context: click.Context) -> Iterator[str]:
    """Yield the words of a command and of all below it."""
    yield context.command_path.partition(" ")[2]
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            below = command.get_command(context, name)
            assert below is not None
            yield from commands(below, click.Context(below, parent=context, info_name=name))


@pytest.mark.parametrize("path", list(commands(main, click.Context(main, info_name="rover"))))
def test_help_has_an_example_that_can_be_typed(path: str) -> None:
    told = CliRunner().invoke(main, [*path.split(), "--help"])
    assert told.exit_code == 0
    _, word, examples = told.output.partition("Example")
    assert word
    assert f"rover {path}".rstrip() in examples
