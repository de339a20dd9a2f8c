"""The operations console: what operators see of rovers in a browser, and command them by."""

from adapters.console.service import PORT, PORT_VARIABLE, Options, running

__all__ = ["PORT", "PORT_VARIABLE", "Options", "running"]
