"""`rover-mops` from start to signal: opens the agent, serves each rover's MRS, and closes all."""

import asyncio
import logging
import os
from collections.abc import Awaitable, Callable, Sequence
from contextlib import AsyncExitStack
from functools import partial
from pathlib import Path
from typing import Final

from adapters.bundle import BundleError, StoreError, listen_error, load_contact_plan
from adapters.mops import load_dictionary
from adapters.mrs.terms import Terms
from adapters.process import StartError, exclusive, termination_event
from adapters.relay.orbiter.link_status import ContactOverrides
from adapters.relay.orbiter.provider import RoverProvider
from adapters.relay.orbiter.relay import OrbiterRelay
from adapters.relay.orbiter.settings import OrbiterSettings
from executive.record import LedgerError

_LOG: Final = logging.getLogger(__name__)

LOOK_S: Final = 1.0
PRUNE_S: Final = 60.0


async def serve(
    settings: OrbiterSettings,
    settings_file: Path,
    host: str,
    data: Path,
    clear_text: bool,
    terms: Terms,
) -> None:
    """Serve until SIGINT or SIGTERM.

    Args:
        settings: the orbiter and its rovers.
        settings_file: where they were read; the contact plan is beside it.
        host: address of the MRS.
        data: folder of bundles and records.
        clear_text: whether the MRS may be served in clear text where others can reach it.
        terms: the encoding and the certificates of the MRS.

    Raises:
        StartError: it cannot start.
    """
    asked = termination_event()
    try:
        async with AsyncExitStack() as stack:
            stack.enter_context(exclusive(data, "orbiter.lock"))
            read_plan = partial(
                load_contact_plan, settings_file, settings.contact_plan, data, settings.node()
            )
            relay = OrbiterRelay(settings, data, read_plan(), load_dictionary())
            stack.push_async_callback(relay.close)
            try:
                await relay.open()
            except OSError as error:
                raise StartError(listen_error(error, settings.listen, settings_file)) from error
            overrides = ContactOverrides(relay.agent, settings.daemon, read_plan)
            providers = [
                RoverProvider(
                    rover,
                    partial(relay.link_status, node),
                    partial(overrides.order, node),
                    settings.silent_after_s,
                    terms,
                )
                for node, rover in relay.rovers.items()
            ]
            tls = terms.for_provider()
            for provider in providers:
                stack.push_async_callback(provider.close)
                try:
                    await provider.start(host, tls, clear_text)
                except (ValueError, OSError) as error:
                    raise _start_error(error, provider, host, settings_file) from error
            for provider in providers:
                print(f"{provider.asset} listens at {provider.uri}", flush=True)
            await _run_until(asked, relay, providers, settings.health_interval_s)
    except (BundleError, LedgerError, OSError, ValueError) as error:
        raise StartError(str(error)) from error


async def _run_until(
    asked: asyncio.Event,
    relay: OrbiterRelay,
    providers: Sequence[RoverProvider],
    health_interval_s: float,
) -> None:
    work = [
        relay.receive(),
        _every(LOOK_S, relay.look),
        _every(LOOK_S, relay.ask_again),
        _every(PRUNE_S, relay.prune),
        *(_every(health_interval_s, provider.tell_health) for provider in providers),
    ]
    async with asyncio.TaskGroup() as group:
        tasks = [group.create_task(each) for each in work]
        await asked.wait()
        for task in tasks:
            task.cancel()


def _start_error(
    error: ValueError | OSError, provider: RoverProvider, host: str, settings_file: Path
) -> StartError:
    if isinstance(error, ValueError):
        return StartError(
            f"{host} can be reached from other computers, and the MRS would be served in"
            " clear text: give --certificate, --key and --authorities, or add --clear-text if"
            " anyone there may read and command"
        )
    why = os.strerror(error.errno) if error.errno and error.errno > 0 else error.strerror
    return StartError(
        f"cannot serve {provider.asset} at {host}:{provider.port}: {why}; choose another"
        f" address with --host, or another port in {settings_file}"
    )


async def _every(interval_s: float, act: Callable[[], Awaitable[None] | None]) -> None:
    while True:
        try:
            work = act()
            if work is not None:
                await work
        except (LedgerError, StoreError) as error:
            _LOG.error("%s", error)
        await asyncio.sleep(interval_s)
