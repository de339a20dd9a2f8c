"""The sub-commands of `rover` that speak the MRS."""

from adapters.mrs.cli.sending import FAILED, connect
from adapters.mrs.cli.target import Target, to_option

__all__ = [
    "FAILED",
    "Target",
    "connect",
    "to_option",
]
