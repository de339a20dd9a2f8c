"""`rover command action`: a text command, or which ones there are."""

import asyncio

import click

from adapters.mrs.cli.arguments import Operation
from adapters.mrs.cli.sending import Sending, connect
from executive.commands import ExecuteAction
from executive.commands.actions import Action


def _next_words(ctx: click.Context, _: click.Parameter, begun: str) -> list[str]:
    """Return how the actions that are known here go on after what is typed."""
    typed = [*(ctx.params.get("words") or ()), begun]
    known = (each.value.split() for each in Action)
    last = len(typed) - 1
    return sorted(
        {
            words[last]
            for words in known
            if last < len(words)
            and words[:last] == [word.upper() for word in typed[:last]]
            and words[last].startswith(begun.upper())
        }
    )


@click.command(cls=Operation)
@click.argument("words", metavar="[TEXT]...", nargs=-1, shell_complete=_next_words)
@click.pass_obj
def action(sending: Sending, words: tuple[str, ...]) -> None:
    """Have a text command done; without one, list what there is.

    \b
    Examples:
      rover command action
      rover command action VIDEO ON
      rover command action VIDEO OFF
    """
    if words:
        sending.send(ExecuteAction(" ".join(words)))
    else:
        asyncio.run(_list(sending))


async def _list(sending: Sending) -> None:
    from adapters.mrs.ground import MrsClient

    async with await connect(MrsClient, sending.to, sending.source) as client:
        for offered in await client.list_actions():
            about = "" if offered.value is None else offered.value.value
            click.echo(f"{offered.name:<12} {about}")
