"""Puts the relay together, serves it until a signal, and takes it apart in the right order."""

import asyncio
import logging
import os
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

from adapters.bundle import BundleError, StoreError, listen_error, load_contact_plan
from adapters.mops import load_dictionary
from adapters.mrs.terms import CLEAR, Terms
from adapters.process import StartError, exclusive, termination_event
from adapters.relay.orbiter.link_status import ContactOverrides
from adapters.relay.orbiter.provider import RoverProvider
from adapters.relay.orbiter.relay import OrbiterRelay
from adapters.relay.orbiter.settings import OrbiterSettings
from executive.record import LedgerError

if TYPE_CHECKING:
    import ssl

_LOG: Final = logging.getLogger(__name__)

LOOK_S: Final = 1.0
PRUNE_S: Final = 60.0


@dataclass(frozen=True, slots=True)
class Options:
    """What the command line says.

    Attributes:
        settings_file: where the settings were read; the contact plan is beside it.
        data: folder of bundles and records.
        clear_text: whether the MRS may be served in clear text where others can reach it.
        terms: the encoding and the certificates of the MRS.
    """

    settings: OrbiterSettings
    settings_file: Path
    host: str
    data: Path
    clear_text: bool = False
    terms: Terms = CLEAR


async def serve(options: Options) -> None:
    """Serve until SIGINT or SIGTERM.

    Raises:
        StartError: it cannot start.
    """
    asked = termination_event()
    try:
        with exclusive(options.data, "orbiter.lock"):
            async with _running(options) as stations:
                for station in stations:
                    print(f"{station.asset} listens at {station.uri}", flush=True)
                await asked.wait()
    except (BundleError, LedgerError, OSError, ValueError) as error:
        raise StartError(str(error)) from error


@asynccontextmanager
async def _running(options: Options) -> AsyncIterator[Sequence[RoverProvider]]:
    settings = options.settings
    read_plan = partial(
        load_contact_plan,
        *(options.settings_file, settings.contact_plan, options.data, settings.node()),
    )
    relay = OrbiterRelay(settings, options.data, read_plan(), load_dictionary())
    try:
        await relay.open()
    except OSError as error:
        raise StartError(listen_error(error, settings.listen, options.settings_file)) from error
    contacts = ContactOverrides(relay.agent, settings.daemon, read_plan)
    stations = [
        RoverProvider(
            *(rover, partial(relay.outlook, node), partial(contacts.order, node)),
            *(settings.silent_after_s, options.terms),
        )
        for node, rover in relay.rovers.items()
    ]
    try:
        tls = options.terms.for_provider()
        for station in stations:
            await _start(station, tls, options)
        async with asyncio.TaskGroup() as group:
            tasks = [
                group.create_task(relay.receive()),
                group.create_task(_every(LOOK_S, relay.look)),
                group.create_task(_every(LOOK_S, relay.ask_again)),
                group.create_task(_every(PRUNE_S, relay.prune)),
                *(
                    group.create_task(_every(settings.health_interval_s, station.tell_health))
                    for station in stations
                ),
            ]
            yield stations
            for task in tasks:
                task.cancel()
    finally:
        for station in stations:
            await station.close()
        await relay.close()


async def _start(station: RoverProvider, tls: "ssl.SSLContext | None", options: Options) -> None:
    try:
        await station.start(options.host, tls, options.clear_text)
    except ValueError as error:
        raise StartError(
            f"{options.host} can be reached from other computers, and the MRS would be served in"
            " clear text: give --certificate, --key and --authorities, or add --clear-text if"
            " anyone there may read and command"
        ) from error
    except OSError as error:
        why = os.strerror(error.errno) if error.errno and error.errno > 0 else error.strerror
        raise StartError(
            f"cannot serve {station.asset} at {options.host}:{station.port}: {why}; choose another"
            f" address with --host, or another port in {options.settings_file}"
        ) from error


async def _every(interval_s: float, act: Callable[[], Awaitable[None] | None]) -> None:
    while True:
        try:
            work = act()
            if work is not None:
                await work
        except (LedgerError, StoreError) as error:
            _LOG.error("%s", error)
        await asyncio.sleep(interval_s)
