"""Puts the console together, and serves it until a signal."""

import ssl
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import click
from aiohttp import web

from adapters.console.access import Access, read_tokens
from adapters.console.fleet import Fleet
from adapters.console.hub import Hub
from adapters.console.messages import Link
from adapters.console.rover_link import Known
from adapters.console.server import Server
from adapters.mal import is_loopback
from adapters.mrs.cli import Target
from adapters.mrs.ground import parse_address
from adapters.process import StartError, exclusive, termination_event

LOCK: Final = "console.lock"


@dataclass(frozen=True, slots=True)
class Options:
    """What the command line says.

    Attributes:
        to: the rovers.
        host, port: where the console is served; 0 for any free port.
        tokens: the file that says who may log in.
        tls: certificate and key, for HTTPS.
        data: the folder of what must survive the process.
    """

    to: tuple[Target, ...]
    host: str
    port: int
    tokens: Path | None
    tls: tuple[Path, Path] | None
    data: Path


async def serve(options: Options) -> None:
    """Serve until SIGINT or SIGTERM.

    Raises:
        StartError: it cannot start.
    """
    ended = termination_event()
    async with running(options) as address:
        click.echo(address)
        await ended.wait()


@asynccontextmanager
async def running(options: Options) -> AsyncIterator[str]:
    """Serve within the context; gives the address for a browser.

    Raises:
        StartError: it cannot start.
    """
    access, context = _access(options)
    with exclusive(options.data, LOCK):
        hub = Hub()
        fleet = Fleet(
            [_uri(target) for target in options.to],
            options.to[0].terms,
            hub.publish,
            hub.sample,
            _nothing_known,
        )
        runner = web.AppRunner(Server(hub, fleet, access).application(), access_log=None)
        await runner.setup()
        site = web.TCPSite(
            runner, options.host, options.port, ssl_context=context, shutdown_timeout=1.0
        )
        try:
            await site.start()
            fleet.start()
            yield _address(options, runner)
        except OSError as error:
            raise StartError(
                f"{options.host}:{options.port} cannot be served ({error.strerror}): stop what is"
                " there, or give another with --port"
            ) from error
        finally:
            await fleet.close()
            await runner.cleanup()


async def _nothing_known(_: str, __: Link) -> Known | None:
    return None


def _access(options: Options) -> tuple[Access, ssl.SSLContext | None]:
    """Return who may ask, and what it is served with."""
    if not is_loopback(options.host) and (options.tokens is None or options.tls is None):
        raise StartError(
            f"other computers can reach {options.host}: say who may log in with --tokens FILE"
            " (lines NAME TOKEN), and serve HTTPS with --tls-certificate PEM --tls-key PEM; or"
            " leave out --host, and use a tunnel such as `ssh -L`"
        )
    context = None
    if options.tls is not None:
        certificate, key = options.tls
        context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
        try:
            context.load_cert_chain(certificate, key)
        except (OSError, ssl.SSLError) as error:
            raise StartError(f"{certificate} with {key} cannot be used: {error}") from error
    tokens = None if options.tokens is None else read_tokens(options.tokens)
    return Access(tokens, secure=context is not None), context


def _uri(target: Target) -> str:
    try:
        return str(parse_address(target.uri))
    except ValueError as error:
        raise click.UsageError(f"--to: {error}") from error


def _address(options: Options, runner: web.AppRunner) -> str:
    port = runner.addresses[0][1]
    host = f"[{options.host}]" if ":" in options.host else options.host
    return f"{'http' if options.tls is None else 'https'}://{host}:{port}/"
