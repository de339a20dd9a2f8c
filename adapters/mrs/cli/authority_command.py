"""The command `rover authority`: shows, requests and transfers a rover's command authority."""

import click

from adapters.mrs.cli.options import QuantityType, json_option, source_option
from adapters.mrs.cli.terminal import echo_json, echo_line, fail, in_session
from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import AuthorityStatus


@click.group()
def authority() -> None:
    """Show, request or transfer the command authority of a rover.

    One operator at a time holds it, with a lease that each command renews. `rover command` requests
    it if it is needed and free. A stop and queries do not need it.

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
    """Show the holder of the authority and its remaining lease.

    \b
    Example:
      rover authority status
    """
    found = await client.authority.status()
    if as_json:
        echo_json(found)
    else:
        echo_line(authority_line(found))


@authority.command()
@click.option("--hold", is_flag=True, help="Renew it until Ctrl-C, then release it.")
@source_option
@in_session
async def request(client: MrsClient, hold: bool) -> None:
    """Request the authority. If it is not free, its holder is notified.

    \b
    Examples:
      rover authority request
      rover authority request --hold --source MOE-2
    """
    echo_line(authority_line(await client.authority.request()))
    if hold:
        await _hold(client)


@authority.command()
@click.option("--hold", is_flag=True, help="Renew it until Ctrl-C, then release it.")
@source_option
@in_session
async def take(client: MrsClient, hold: bool) -> None:
    """Take the authority over from its holder, if the rover's settings allow this source to.

    \b
    Example:
      rover authority take --source FLIGHT-DIRECTOR
    """
    echo_line(authority_line(await client.authority.take()))
    if hold:
        await _hold(client)


@authority.command("hand-over")
@click.argument("to_source", metavar="TO")
@click.option(
    "--lease",
    "lease_s",
    type=QuantityType("s"),
    metavar="TIME",
    help="Maximum time without a command of TO, e.g. of an orbiter between contacts: 60 or 1d.",
)
@source_option
@in_session
async def hand_over(client: MrsClient, to_source: str, lease_s: float | None) -> None:
    """Hand the authority over to another operator or to the orbiter.

    \b
    Examples:
      rover authority hand-over MOE-2
      rover authority hand-over MOPS --lease 86400
    """
    echo_line(authority_line(await client.authority.hand_over(to_source, lease_s)))


@authority.command()
@source_option
@in_session
async def release(client: MrsClient) -> None:
    """Release the authority.

    \b
    Example:
      rover authority release
    """
    echo_line(authority_line(await client.authority.release()))


async def _hold(client: MrsClient) -> None:
    """Hold the authority until Ctrl-C; exits 1 if it is lost to another holder."""
    try:
        await client.authority.wait_lost()
    finally:
        if client.authority.epoch is not None:
            await client.authority.release()
    fail(f"authority lost: {authority_line(await client.authority.status())}")


def authority_line(status: AuthorityStatus) -> str:
    """Return the status of the authority in one line."""
    need = "" if status.needed else "; not needed for commands"
    if status.holder is None:
        return f"authority free{need}"
    requested = f"; {status.requestedBy} requests it" if status.requestedBy else ""
    return (
        f"{status.holder} holds the authority, epoch {status.epoch},"
        f" lease {status.leaseLeft:.0f} s{requested}{need}"
    )
