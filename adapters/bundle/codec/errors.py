"""What can go wrong with bundles."""


class BundleError(Exception):
    """The root of every error of this package."""


class DecodeError(BundleError, ValueError):
    """Octets from outside are not what the standard allows; the text is one line."""


class StoreError(BundleError):
    """The store cannot be read or written; the text says which file and why."""


class StoreFull(StoreError):  # noqa: N818 - a state the caller waits out, not a fault
    """The store takes no more until something leaves it."""


class AgentClosed(BundleError):  # noqa: N818 - the end of a life, not a fault
    """The agent is not open, or was closed during the call."""
