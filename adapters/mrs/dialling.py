"""How other rovers are connected to: on the terms on which this one serves."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from adapters.mrs.specification import mrs_specification
from adapters.mrs.terms import Terms

if TYPE_CHECKING:
    from adapters.mal.consumer import Consumer
    from adapters.mal.uri import MalUri

TIMEOUT_S: Final = 5.0


@dataclass(frozen=True, slots=True)
class Dialling:
    """Connects to providers.

    Attributes:
        name: what this end calls itself.
        terms: the encoding, and the certificates of this end.
    """

    name: str
    terms: Terms

    async def connect(self, uri: "str | MalUri", timeout_s: float = TIMEOUT_S) -> "Consumer":
        """Connect; each reply is waited for as long as for the connection.

        Raises:
            CertificateError: a certificate file cannot be used any more.
            MalError: nobody answers there, or TLS could not be agreed on.
            ValueError: the URI is none.
        """
        from adapters.mal.consumer import Consumer  # who asks nobody need not know how

        encoding, tls = self.terms.encoding, self.terms.for_consumer()
        return await Consumer.connect(
            mrs_specification(), uri, self.name, encoding, timeout_s, tls=tls
        )
