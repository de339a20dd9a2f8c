"""The operations console: what operators see of rovers in a browser, and command them by."""

from adapters.console.service import Options, running

__all__ = ["Options", "running"]
