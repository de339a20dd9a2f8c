"""`rover command action`: a text command, or which ones there are."""

import asyncio

import click

from adapters.mrs.sending import Sending, connect
from executive.commands import ExecuteAction


@click.command()
@click.argument("words", metavar="[TEXT]...", nargs=-1)
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
    from adapters.mrs.client import MrsClient

    async with await connect(MrsClient, sending.to, sending.source) as client:
        for offered in await client.list_actions():
            about = "" if offered.value is None else offered.value.value
            click.echo(f"{offered.name:<12} {about}")
