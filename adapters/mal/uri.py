"""URIs of MAL over TCP: `maltcp://host:port/name`."""

from dataclasses import dataclass
from typing import Final
from urllib.parse import urlsplit

SCHEME: Final = "maltcp"
_BROKER: Final = "InternalBroker"


@dataclass(frozen=True, slots=True)
class MalUri:
    """Where a consumer, provider or broker is, and its name there."""

    host: str
    port: int
    name: str

    @classmethod
    def parse(cls, text: str) -> "MalUri":
        """Read `maltcp://host:port/name`.

        Raises:
            ValueError: It is not of this form.
        """
        parts = urlsplit(text)
        if (
            parts.scheme != SCHEME
            or not parts.hostname
            or parts.port is None
            or len(parts.path) < 2
        ):
            raise ValueError(f"{text!r} is not {SCHEME}://host:port/name")
        return cls(parts.hostname, parts.port, parts.path[1:])

    @property
    def broker(self) -> "MalUri":
        """The broker that belongs to a provider, named as ESA does."""
        return MalUri(self.host, self.port, self.name + _BROKER)

    def __str__(self) -> str:
        """The URI as text."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{SCHEME}://{host}:{self.port}/{self.name}"
