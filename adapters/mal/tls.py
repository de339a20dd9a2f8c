"""`Certificates` for mutual TLS: both ends authenticate by certificate."""

import ipaddress
import socket
import ssl
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any


class CertificateError(OSError):
    """A certificate or key file cannot be used; the text names file and reason."""


@dataclass(frozen=True, slots=True)
class Certificates:
    """The certificate of this end, and the authorities that it trusts.

    Attributes:
        certificate: PEM file with the certificate of this end and the intermediate ones, if any.
            A provider's names its host or address as a subjectAltName.
        key: PEM file with its private key, without a password.
        authorities: PEM file with the certificates of the authorities that sign the peers'.
    """

    certificate: Path
    key: Path
    authorities: Path

    def for_provider(self) -> ssl.SSLContext:
        """Return the context of a provider; it rejects clients not signed by its authorities.

        Raises:
            CertificateError: A file is missing or no such PEM file, or key and certificate do not
                match.
        """
        context = self._context(ssl.Purpose.CLIENT_AUTH)
        context.verify_mode = ssl.CERT_REQUIRED
        return context

    def for_consumer(self) -> ssl.SSLContext:
        """Return the context of a consumer; it also checks the provider's name.

        Raises:
            CertificateError: As in `for_provider`.
        """
        return self._context(ssl.Purpose.SERVER_AUTH)

    def name(self) -> str | None:
        """Return the name in the certificate of this end, as its peers will read it.

        The standard library only parses a trusted peer's certificate. So this end makes an
        in-memory handshake with itself, in which it trusts its own certificate.

        Raises:
            CertificateError: As in `for_provider`.
        """
        ours, theirs = self.for_consumer(), self.for_provider()
        ours.check_hostname, ours.verify_mode = False, ssl.CERT_NONE
        theirs.load_verify_locations(self.certificate)
        theirs.verify_flags |= ssl.VERIFY_X509_PARTIAL_CHAIN
        forward, back = ssl.MemoryBIO(), ssl.MemoryBIO()
        consumer = ours.wrap_bio(back, forward)
        provider = theirs.wrap_bio(forward, back, server_side=True)
        for end in (consumer, provider, consumer, provider):
            try:
                end.do_handshake()
            except ssl.SSLWantReadError:
                continue
            except ssl.SSLError as error:
                raise CertificateError(
                    f"{self.certificate}: is not usable with {self.authorities} ({error})"
                ) from error
        certificate = provider.getpeercert()
        return certificate_name(certificate) if certificate else None

    def _context(self, purpose: ssl.Purpose) -> ssl.SSLContext:
        for path in (self.certificate, self.key, self.authorities):
            _check_readable(path)
        try:
            context = ssl.create_default_context(purpose, cafile=str(self.authorities))
        except ssl.SSLError as error:
            raise CertificateError(f"{self.authorities}: contains no PEM certificate") from error
        context.minimum_version = ssl.TLSVersion.TLSv1_2
        context.verify_flags |= ssl.VERIFY_X509_STRICT  # by default only since Python 3.13
        try:
            context.load_cert_chain(self.certificate, self.key, self._no_password)
        except ssl.SSLError as error:
            raise CertificateError(
                f"{self.certificate} and {self.key}: are not a certificate in PEM and its private"
                f" key ({error.reason or error})"
            ) from error
        return context

    def _no_password(self) -> str:
        raise CertificateError(f"{self.key}: has a password; use a key without one")


def _check_readable(path: Path) -> None:
    try:
        path.open("rb").close()
    except OSError as error:
        raise CertificateError(f"{path}: {error.strerror}") from error


def certificate_name(certificate: Mapping[str, Any]) -> str | None:
    """Return the name in a verified certificate, or None.

    It is the common name of the subject, else the first subjectAltName. A name with unprintable
    characters counts as none. `certificate` is in the format of `ssl.SSLSocket.getpeercert`.
    """
    subject = [pair for names in certificate.get("subject", ()) for pair in names]
    common = [name for kind, name in subject if kind == "commonName"]
    names = [*common, *(name for _, name in certificate.get("subjectAltName", ()))]
    return names[0] if names and names[0].isprintable() else None


def is_loopback(host: str) -> bool:
    """Whether an address to listen on is reachable from this host only."""
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return host == "localhost"


def address_to_listen(host: str) -> str:
    """Return a host without the brackets of IPv6 in a URI; raises OSError if it is unknown."""
    host = host.strip("[]")
    try:
        socket.getaddrinfo(host or None, 0, flags=socket.AI_PASSIVE)
    except UnicodeError as error:  # longer than a host name may be
        raise socket.gaierror(socket.EAI_NONAME, "Name or service not known") from error
    return host
