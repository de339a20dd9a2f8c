"""`rover completion`: the script that lets a shell complete the `rover` command."""

import click
from click.shell_completion import get_completion_class


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
