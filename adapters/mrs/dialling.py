"""How other rovers are connected to: on the terms on which this one serves."""

from typing import TYPE_CHECKING, Final

from adapters.mrs.specification import mrs_specification
from adapters.mrs.terms import Terms

if TYPE_CHECKING:
    import ssl

    from adapters.mal import Consumer, MalUri

TIMEOUT_S: Final = 5.0


class Dialling:
    """Connects to providers.

    Args:
        name: what this end calls itself.
        terms: the encoding, and the certificates of this end, which are read when first needed.
    """

    def __init__(self, name: str, terms: Terms) -> None:
        """Connect to nobody yet."""
        self._name = name
        self._terms = terms
        self._tls: ssl.SSLContext | None = None

    async def connect(self, uri: "str | MalUri", timeout_s: float = TIMEOUT_S) -> "Consumer":
        """Connect; each reply is waited for as long as for the connection.

        Raises:
            CertificateError: a certificate file cannot be used any more.
            MalError: nobody answers there, or TLS could not be agreed on.
            ValueError: the URI is none.
        """
        from adapters.mal import Consumer

        if self._tls is None:
            self._tls = self._terms.for_consumer()
        encoding = self._terms.encoding
        return await Consumer.connect(
            mrs_specification(), uri, self._name, encoding, timeout_s, tls=self._tls
        )
