"""What both ends of a link agree on beforehand, since no message says it."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from adapters.mal import Certificates, Encoding

if TYPE_CHECKING:
    import ssl

NAME: Final = "MRS"
PORT: Final = 21000
"""TCP port of a rover, below the ports that Linux hands out by itself (32768 to 60999)."""


class TermsError(ConnectionError):
    """Somebody is there, on other terms as it seems; the text says what does not fit."""


@dataclass(frozen=True, slots=True)
class Terms:
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


CLEAR: Final = Terms()
"""Fixed binary encoding in clear text."""
