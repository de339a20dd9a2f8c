"""`announce` prints that a process serves; it and `notify` report to systemd as sd_notify does."""

import os
import socket
from contextlib import suppress
from typing import Final

READY: Final = "READY=1"
ALIVE: Final = "WATCHDOG=1"


def announce(text: str) -> None:
    """Print that this process serves, and report it to a systemd unit of Type=notify."""
    print(text, flush=True)
    notify(f"{READY}\nSTATUS={text}")


def notify(state: str) -> None:
    """Send a state to the service manager. Never blocks; without a manager nothing is sent."""
    address = os.environ.get("NOTIFY_SOCKET", "")
    if not address:
        return
    address = address.replace("@", "\0", 1) if address[0] == "@" else address
    with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:  # noqa: TID251 - to systemd alone
        sender.setblocking(False)
        sender.sendto(state.encode(), address)


def watchdog_period_s() -> float | None:
    """Return the period of the heartbeats for WatchdogSec= of the unit; None without it."""
    if os.environ.get("WATCHDOG_PID", str(os.getpid())) != str(os.getpid()):
        return None
    timeout_us = os.environ.get("WATCHDOG_USEC", "")
    return int(timeout_us) * 1e-6 / 2 if timeout_us.isdecimal() and int(timeout_us) else None
