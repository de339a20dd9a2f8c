"""`rover authority`: who may command a rover, and how that passes on."""

import click

from adapters.mrs.cli.options import json_option, source_option
from adapters.mrs.cli.terminal import echo_json, fail, in_session, say
from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import AuthorityStatus


@click.group()
def authority() -> None:
    """Show who may command a rover, and request or pass on that authority.

    One operator at a time holds it, by a lease that each command renews. `rover command` requests
    it by itself where it is needed and free. To stop, and to read, nobody needs it.

    \b
    Examples:
      rover authority status
      rover authority request --hold
      rover authority hand-over MOPS --lease 86400
      rover authority release
    """


@authority.command()
@json_option
@in_session
async def status(client: MrsClient, as_json: bool) -> None:
    """Show who holds the authority, and for how long.

    \b
    Example:
      rover authority status
    """
    found = await client.authority.status()
    if as_json:
        echo_json(found)
    else:
        say(authority_line(found))


@authority.command()
@click.option("--hold", is_flag=True, help="Renew it until Ctrl-C, then give it up.")
@source_option
@in_session
async def request(client: MrsClient, hold: bool) -> None:
    """Get the authority if it is free; else its holder is told who asks.

    \b
    Examples:
      rover authority request
      rover authority request --hold --source MOE-2
    """
    say(authority_line(await client.authority.request()))
    if hold:
        await _hold(client)


@authority.command()
@click.option("--hold", is_flag=True, help="Renew it until Ctrl-C, then give it up.")
@source_option
@in_session
async def take(client: MrsClient, hold: bool) -> None:
    """Take the authority from its holder, where the rover's settings let this source.

    \b
    Example:
      rover authority take --source FLIGHT-DIRECTOR
    """
    say(authority_line(await client.authority.take()))
    if hold:
        await _hold(client)


@authority.command("hand-over")
@click.argument("to_source", metavar="TO")
@click.option(
    "--lease",
    "lease_s",
    type=float,
    metavar="SECONDS",
    help="How long TO may be silent, such as an orbiter between contacts.",
)
@source_option
@in_session
async def hand_over(client: MrsClient, to_source: str, lease_s: float | None) -> None:
    """Give the authority to another operator, or to the orbiter.

    \b
    Examples:
      rover authority hand-over MOE-2
      rover authority hand-over MOPS --lease 86400
    """
    say(authority_line(await client.authority.hand_over(to_source, lease_s)))


@authority.command()
@source_option
@in_session
async def release(client: MrsClient) -> None:
    """Give the authority up.

    \b
    Example:
      rover authority release
    """
    say(authority_line(await client.authority.release()))


async def _hold(client: MrsClient) -> None:
    """Keep the authority until Ctrl-C; exits 1 when somebody else has it."""
    try:
        await client.authority.lost()
    finally:
        if client.authority.epoch is not None:
            await client.authority.release()
    fail(f"it is held no more: {authority_line(await client.authority.status())}")


def authority_line(status: AuthorityStatus) -> str:
    """Return in one line who may command."""
    need = "" if status.needed else "; commands need none"
    if status.holder is None:
        return f"nobody holds the authority{need}"
    asked = f"; {status.askedBy} asks for it" if status.askedBy else ""
    return (
        f"{status.holder} holds the authority, epoch {status.epoch},"
        f" for another {status.leaseLeft:.0f} s{asked}{need}"
    )
