"""The command `rover mops`: an operator without mission control commands a rover line by line."""

import asyncio
import sys
import threading
from collections.abc import AsyncIterator
from contextlib import suppress
from typing import Final, TextIO

import click

from adapters.mrs.cli import FAILED, RoverTarget, connect, to_option

_END: Final = ""


@click.command()
@to_option
@click.option("--source", default="MOPS", show_default=True, help="Source name of the commands.")
@click.option("--no-telemetry", is_flag=True, help="Print parameters only on request, by `status`.")
def mops(to: RoverTarget, source: str, no_telemetry: bool) -> None:
    """Send commands as lines, and print RECEIVED, EXECUTED, telemetry and link status as lines.

    Each line begins with the time in UTC and one word, its type. At the end of the
    input it waits for the end of every command; `help` lists the commands.

    \b
    Examples:
      rover mops --to 127.0.0.1:21100
      echo "moveForward 1.5" | rover mops --to 127.0.0.1:21100 --no-telemetry

    \b
    Exit status: 0 all EXECUTED, 1 one was refused or ended otherwise, 3 cannot be reached.
    """
    if not asyncio.run(_serve(to, source, telemetry=not no_telemetry)):
        sys.exit(FAILED)


async def _serve(to: RoverTarget, source: str, telemetry: bool) -> bool:
    from adapters.mops import load_dictionary
    from adapters.relay.orbiter.console import Console

    async with await connect(to, source) as client:
        console = Console(client, load_dictionary(), click.echo)
        await console.run(_lines(sys.stdin), telemetry)
        return console.well


async def _lines(stream: TextIO) -> AsyncIterator[str]:
    """Yield lines as they are typed; a daemon thread reads, so that exit need not wait for it."""
    loop = asyncio.get_running_loop()
    typed: asyncio.Queue[str] = asyncio.Queue()

    def read() -> None:
        with suppress(RuntimeError, ValueError):  # the loop or the stream is closed
            for text in iter(stream.readline, _END):
                loop.call_soon_threadsafe(typed.put_nowait, text)
            loop.call_soon_threadsafe(typed.put_nowait, _END)

    threading.Thread(target=read, daemon=True).start()
    while (text := await typed.get()) != _END:
        yield text
