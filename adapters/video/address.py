"""Where a stream of datagrams goes, as people type it."""

from executive.settings import HIGHEST_PORT


def parse_address(text: str) -> tuple[str, int]:
    """Return host and port of `HOST:PORT`; an IPv6 address stands in brackets.

    Raises:
        ValueError: it is not that.
    """
    host, _, port = text.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) <= HIGHEST_PORT:
        raise ValueError(f"{text!r} is not HOST:PORT, with a port of 1 to {HIGHEST_PORT}")
    return host.strip("[]"), int(port)
