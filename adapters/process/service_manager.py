"""`announce` prints that a process serves; it and `notify` report to systemd as sd_notify does."""

import os
import socket
from contextlib import suppress
from threading import Thread
from typing import Final

READY_TIMEOUT_S: Final = 5.0
"""READY=1 is sent once, so it waits while the queue of the service manager is full, as at boot."""
ALIVE: Final = "WATCHDOG=1"


def announce(text: str) -> None:
    """Print that this process serves, and report it to a systemd unit of Type=notify."""
    print(text, flush=True)
    sent = f"READY=1\nSTATUS={text}", READY_TIMEOUT_S
    Thread(target=notify, args=sent, daemon=True).start()  # the caller may have to tick


def notify(state: str, timeout_s: float = 0.0) -> None:
    """Send a state to the service manager, and drop it at the timeout; without one do nothing."""
    address = os.environ.get("NOTIFY_SOCKET", "")
    address = f"\0{address[1:]}" if address[:1] == "@" else address
    with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:  # noqa: TID251 - to systemd alone
        sender.settimeout(timeout_s)
        sender.sendto(state.encode(), address)


def watchdog_period_s() -> float | None:
    """Return the period of the heartbeats for WatchdogSec= of the unit; None without it."""
    if os.environ.get("WATCHDOG_PID", str(os.getpid())) != str(os.getpid()):
        return None
    timeout_us = os.environ.get("WATCHDOG_USEC", "")
    return int(timeout_us) * 1e-6 / 2 if timeout_us.isdecimal() and int(timeout_us) else None
