"""The `rover` command: finds its sub-commands by entry points and gives exit codes their meaning.

It knows no sub-command by name. Each is an entry point in the group `rover.commands`, imported when
it is called, or when help wants its first line.
"""

import os
import sys
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Final

import click
from click.shell_completion import get_completion_class

GROUP: Final = "rover.commands"
UNREACHABLE: Final = 3
INTERRUPTED: Final = 130
UNREAD: Final = 141


class Commands(click.Group):
    """A click group whose commands are the entry points of `rover.commands`."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all commands, sorted."""
        return sorted(_found())

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import and return one command, or None where no package provides it."""
        entry = _found().get(cmd_name)
        if entry is None:
            return None
        command = entry.load()
        if not isinstance(command, click.Command):
            raise TypeError(f"entry point {entry.value} is no click command")
        return command

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; a lost or absent connection and Ctrl-C get exit codes of their own."""
        try:
            return super().invoke(ctx)
        except BrokenPipeError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            ctx.exit(UNREAD)
        except (ConnectionError, TimeoutError) as error:
            click.echo(f"Error: cannot reach the rover: {error}", err=True)
            ctx.exit(UNREACHABLE)
        except (KeyboardInterrupt, click.Abort):
            click.echo("Interrupted.", err=True)
            ctx.exit(INTERRUPTED)


def _found() -> dict[str, EntryPoint]:
    return {entry.name: entry for entry in entry_points(group=GROUP)}


@click.group(
    cls=Commands,
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
      rover command moveTo 3 2 --heading 90deg  then, from a second terminal
      rover status
      rover watch
      rover test                                all checks of this checkout

    \b
    Exit status:
      0    done
      1    what was asked for failed, such as a command that ended FAILED or REJECTED
      2    the command line or a file given to it makes no sense
      3    the rover cannot be reached
      130  interrupted by Ctrl-C
      141  nobody reads the output any more
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
