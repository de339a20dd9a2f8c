"""TLS for both ends, mutual: each shows a certificate and checks the other's."""

import ipaddress
import ssl
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Certificates:
    """Who this end is, and whom it believes.

    Attributes:
        certificate: PEM file with the certificate of this end, and those between it and the
            authority, if any. A provider's names its host or address as a subjectAltName.
        key: PEM file with its private key, without a password.
        authorities: PEM file with the certificates of the authorities that vouch for other ends.
    """

    certificate: Path
    key: Path
    authorities: Path

    def for_provider(self) -> ssl.SSLContext:
        """What a provider listens with: it refuses who shows no certificate of the authorities.

        Raises:
            OSError: A file is missing or no such PEM file (ssl.SSLError), or key and certificate
                are not of one another.
        """
        context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH, cafile=str(self.authorities))
        context.verify_mode = ssl.CERT_REQUIRED
        return self._own(context)

    def for_consumer(self) -> ssl.SSLContext:
        """What a consumer connects with; it checks the provider's name, too.

        Raises:
            OSError: As of `for_provider`.
        """
        context = ssl.create_default_context(ssl.Purpose.SERVER_AUTH, cafile=str(self.authorities))
        return self._own(context)

    def _own(self, context: ssl.SSLContext) -> ssl.SSLContext:
        context.minimum_version = ssl.TLSVersion.TLSv1_2
        context.load_cert_chain(self.certificate, self.key)
        return context


def is_loopback(host: str) -> bool:
    """Whether only this computer can reach an address to listen on."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
