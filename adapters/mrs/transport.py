"""`TransportSettings` of a link: encoding, certificates, and its declared round-trip time."""

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from adapters.mal import CertificateError, Certificates, Encoding

if TYPE_CHECKING:
    import ssl

NAME: Final = "MRS"
PORT: Final = 21000
"""TCP port of a rover, below the ephemeral ports of Linux (32768 to 60999)."""
CURRENT_RECORDING: Final = "current-recording"
"""Folder with a copy of the executive's recording; a list of this folder makes the copy."""


class TransportMismatchError(ConnectionError):
    """A peer answers, but encoding or TLS does not match; the text names the mismatch."""


@dataclass(frozen=True, slots=True)
class TransportSettings:
    """Encoding and certificates of one end of the direct link, agreed since messages lack them.

    Attributes:
        encoding: encoding of message bodies.
        certificates: for TLS, mutual; None for clear text.
        round_trip_s: declared round-trip time of the link, s; a client adds it to its timeouts.
    """

    encoding: Encoding = Encoding.FIXED
    certificates: Certificates | None = None
    round_trip_s: float = 0.0

    def for_provider(self) -> "ssl.SSLContext | None":
        """Return the TLS context of a server; None for clear text.

        Raises:
            CertificateError: a file cannot be used.
        """
        return None if self.certificates is None else self.certificates.for_provider()

    def for_consumer(self) -> "ssl.SSLContext | None":
        """Return the TLS context of a client; raises as `for_provider` does."""
        return None if self.certificates is None else self.certificates.for_consumer()


CLEAR: Final = TransportSettings()
"""Fixed binary encoding in clear text."""


def start_fault(error: ValueError | OSError, what: str, host: str, alternative: str) -> str:
    """Return the reason why a link is not served, for the command line: `cannot {what}`."""
    if isinstance(error, ValueError):
        return (
            f"{host} is reachable from other hosts, where the MRS would be served in clear text:"
            " give --certificate, --key and --authorities, or add --clear-text if every host"
            " there may read and command"
        )
    if isinstance(error, CertificateError):
        files = "--certificate, --key and --authorities name PEM files"
        return f"TLS: {error}; {files} that this process can read"
    why = os.strerror(error.errno) if error.errno and error.errno > 0 else error.strerror or error
    return f"cannot {what}: {why}; choose another address with --host{alternative}"
