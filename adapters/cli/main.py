"""The `rover` command: finds its sub-commands by entry points, and maps exceptions to exit codes.

Each sub-command is an entry point in the group `rover.commands`, or in the list of a checkout. It
is imported only when called: `rover --help` reads the first line of its docstring from the source.
"""

import ast
import errno
import sys
import tomllib
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import click
from click.shell_completion import get_completion_class

from adapters.process import guard_output, missing_package

GROUP: Final = "rover.commands"
CHECKOUT: Final = Path(__file__).resolve().parents[2]
CHECKOUT_COMMANDS: Final = CHECKOUT / "tests" / "commands.toml"
"""List of the commands that need a checkout, as entry points; not in an installed wheel."""
OPERATIONS: Final = EntryPoint("operations", "adapters.mrs.cli.command_group:operations", GROUP)
"""Group of the rover's operations, which are commands, too; loaded for names not found else."""
UNREACHABLE: Final = 3
INTERRUPTED: Final = 130


class EntryPointGroup(click.Group):
    """A click group whose commands are entry points."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all commands, sorted."""
        return sorted(_found())

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import and return one command; an unknown name is a usage error."""
        found = _found()
        entry = found.get(cmd_name)
        if entry is None:
            operations = OPERATIONS.load()
            operation: click.Command | None = operations.get_command(ctx, cmd_name)
            if operation is None and not ctx.resilient_parsing:
                raise operations.unknown(ctx, cmd_name, found)
            return operation
        command = entry.load()
        if not isinstance(command, click.Command):
            raise TypeError(f"entry point {entry.value} is no click command")
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the first line of each command's help."""
        found = sorted(_found().items())
        limit = formatter.width - 6 - max((len(name) for name, _ in found), default=0)
        with formatter.section("Commands"):
            formatter.write_dl([(name, _first_line(entry, limit)) for name, entry in found])

    def main(self, *arguments: Any, **options: Any) -> Any:
        """Run the command line."""
        guard_output()
        return super().main(*arguments, **options)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; connection errors and Ctrl-C have separate exit codes."""
        try:
            return super().invoke(ctx)
        except ModuleNotFoundError as error:
            text = missing_package(error)
            if text is None:
                raise
            raise click.ClickException(text) from error
        except (ConnectionError, TimeoutError) as error:
            from executive.values.reports import printable

            click.echo(f"Error: cannot reach the rover: {printable(str(error))}", err=True)
            ctx.exit(UNREACHABLE)
        except OSError as error:
            if error.errno != errno.ENOSPC:
                raise
            where = f"{error.filename}: " if error.filename else ""
            raise click.ClickException(f"{where}cannot be written: {error.strerror}") from error
        except (KeyboardInterrupt, click.Abort):
            click.echo("Interrupted.", err=True)
            ctx.exit(INTERRUPTED)


@cache
def _found() -> dict[str, EntryPoint]:
    """Return the commands by name; one of the checkout replaces an installed one."""
    found = {entry.name: entry for entry in entry_points(group=GROUP)}
    if CHECKOUT_COMMANDS.is_file():
        sys.path.append(str(CHECKOUT))
        table = tomllib.loads(CHECKOUT_COMMANDS.read_text(encoding="utf-8"))
        found |= {name: EntryPoint(name, value, GROUP) for name, value in table.items()}
    return found


def _first_line(entry: EntryPoint, limit: int) -> str:
    """Return the short help of a command, if possible from its source without importing it."""
    package, *inner = entry.module.split(".")
    spec = find_spec(package)
    for folder in (spec.submodule_search_locations if spec is not None else None) or ():
        source = Path(folder, *inner).with_suffix(".py")
        for node in ast.parse(source.read_bytes()).body:
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and node.name == entry.attr:
                command = click.Command(entry.name, help=ast.get_docstring(node))
                return command.get_short_help_str(limit)
    loaded: click.Command = entry.load()
    return loaded.get_short_help_str(limit)


@click.group(
    cls=EntryPointGroup,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog="Every command has its own --help with examples.",
)
@click.version_option(package_name="rover-executive", message="rover %(version)s")
def main() -> None:
    """Simulate, command and watch a rover.

    \b
    Examples:
      rover demo                                a mission-control session against a simulated rover
      rover demo --stay                         the same, and leave the rover running
      rover moveTo 3 2 --heading 90deg          then, from a second terminal
      rover stop                                stop it immediately; rover resume releases it
      rover status
      rover watch

    Each operation that `rover command` lists is a command, such as moveTo.

    \b
    Exit status:
      0    done
      1    the operation failed, such as a command that ended FAILED or REJECTED
      2    the command line or an input file is invalid
      3    the rover is not reachable
      130  interrupted by Ctrl-C
      141  the reader of the output is closed
    """


@click.command()
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
@click.pass_context
def completion(ctx: click.Context, shell: str) -> None:
    """Print the script that completes commands and options.

    \b
    Examples:
      eval "$(./rover completion bash)"     in this shell
      ./rover completion bash >> ~/.bashrc  in every new one
      ./rover completion fish > ~/.config/fish/completions/rover.fish
    """
    script = get_completion_class(shell)
    assert script is not None
    program = ctx.find_root()
    click.echo(script(program.command, {}, "rover", "_ROVER_COMPLETE").source())
