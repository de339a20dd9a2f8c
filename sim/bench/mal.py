"""What the MAL stack costs and reaches on loopback, beside plain asyncio TCP."""

import asyncio

from sim.bench.figures import Figure
from sim.bench.mal_fan_out import fan_out
from sim.bench.mal_provider import FILE
from sim.bench.mal_requests import requests
from sim.bench.mal_transfer import transfer
from sim.bench.processes import Bench, port_of


def measure(samples: int = 3000, transfers: int = 7, duration_s: float = 5.0) -> list[Figure]:
    """Return the figures of requests, of notifications and of a transfer.

    Args:
        samples: how many requests and echoes, in turn.
        transfers: how many transfers each way, in turn.
        duration_s: how long notifications are taken, for each number of subscribers.
    """
    with (
        Bench() as bench,
        bench.started("provider", "sim.bench.mal_provider", f"{bench.folder}/files") as provider,
        bench.started("echo", "sim.bench.bare_tcp") as echo,
        bench.started("source", "sim.bench.bare_tcp", f"{bench.folder}/files/{FILE}") as source,
    ):
        uri = f"maltcp://127.0.0.1:{port_of(provider)}/MRS"
        return [
            *asyncio.run(requests(uri, port_of(echo), samples)),
            *asyncio.run(fan_out(uri, provider.pid, duration_s)),
            *asyncio.run(transfer(uri, port_of(source), transfers)),
        ]
