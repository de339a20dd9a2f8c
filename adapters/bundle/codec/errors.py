"""`BundleError` and its subclasses: all errors of the bundle package."""


class BundleError(Exception):
    """Base class of every error of this package."""


class DecodeError(BundleError, ValueError):
    """Received octets violate the standard; the text is one line."""


class StoreError(BundleError):
    """The store cannot be read or written; the text names the file and the cause."""


class StoreFull(StoreError):  # noqa: N818 - a state that the caller waits out, not a fault
    """The store is full and accepts nothing until bundles leave it."""


class AgentClosed(BundleError):  # noqa: N818 - the end of an agent, not a fault
    """The agent is not open, or was closed during the call."""
