"""What both ends of a link agree on beforehand, since no message says it."""

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from adapters.mal import CertificateError, Certificates, Encoding

if TYPE_CHECKING:
    import ssl

NAME: Final = "MRS"
PORT: Final = 21000
"""TCP port of a rover, below the ports that Linux hands out by itself (32768 to 60999)."""


class TransportMismatchError(ConnectionError):
    """Somebody is there, on other terms as it seems; the text says what does not fit."""


@dataclass(frozen=True, slots=True)
class TransportSettings:
    """How an end of the direct link writes, and whom it believes.

    Attributes:
        encoding: of message bodies.
        certificates: for TLS, mutual; None for clear text.
    """

    encoding: Encoding = Encoding.FIXED
    certificates: Certificates | None = None

    def for_provider(self) -> "ssl.SSLContext | None":
        """Return what the rover listens with.

        Raises:
            CertificateError: a file cannot be used.
        """
        return None if self.certificates is None else self.certificates.for_provider()

    def for_consumer(self) -> "ssl.SSLContext | None":
        """Return what the ground connects with; raises as `for_provider` does."""
        return None if self.certificates is None else self.certificates.for_consumer()


CLEAR: Final = TransportSettings()
"""Fixed binary encoding in clear text."""


def start_fault(error: ValueError | OSError, what: str, host: str, elsewhere: str) -> str:
    """Return why a link is not served, for who started the process: `cannot {what}`."""
    if isinstance(error, ValueError):
        return (
            f"{host} can be reached from other computers, and the MRS would be served in clear"
            " text: give --certificate, --key and --authorities, or add --clear-text if anyone"
            " there may read and command"
        )
    if isinstance(error, CertificateError):
        files = "--certificate, --key and --authorities name PEM files"
        return f"TLS: {error}; {files} that this process can read"
    why = os.strerror(error.errno) if error.errno and error.errno > 0 else error.strerror or error
    return f"cannot {what}: {why}; choose another address with --host{elsewhere}"
