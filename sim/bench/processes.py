"""Processes to measure, on a ROS domain of their own, ended with the `with`."""

import os
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

DOMAINS = range(60, 100)
END_S = 10.0


@contextmanager
def own_domain() -> Iterator[None]:
    """Set ROS_DOMAIN_ID to one that nobody on this machine listens on, for the time of the with."""
    before = os.environ.get("ROS_DOMAIN_ID")
    os.environ["ROS_DOMAIN_ID"] = str(_free_domain())
    try:
        yield
    finally:
        if before is None:
            del os.environ["ROS_DOMAIN_ID"]
        else:
            os.environ["ROS_DOMAIN_ID"] = before


@contextmanager
def module(name: str, *arguments: str) -> Iterator["subprocess.Popen[str]"]:
    """Run a module of ours as a process, its standard output a pipe."""
    with subprocess.Popen(
        [sys.executable, "-m", name, *arguments], stdout=subprocess.PIPE, text=True
    ) as process:
        try:
            yield process
        finally:
            process.send_signal(signal.SIGTERM)
            try:
                process.wait(END_S)
            except subprocess.TimeoutExpired:
                process.kill()


def port_of(process: "subprocess.Popen[str]") -> int:
    """Return the port that a process says it listens at.

    Raises:
        RuntimeError: it ended without saying so.
    """
    assert process.stdout is not None
    for line in process.stdout:
        found = re.search(r"listens at \D*(?:[\d.]+:)?(\d+)", line)
        if found:
            return int(found[1])
    raise RuntimeError(f"{process.args!r} ended before it listened")


def _free_domain() -> int:
    for domain in DOMAINS:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(("", 7400 + 250 * domain))
            except OSError:
                continue
            return domain
    raise RuntimeError("all ROS domain ids are in use")
