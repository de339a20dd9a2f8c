"""The sub-commands of `rover` that speak the MRS, each a module beside this face."""

from adapters.mrs.cli.options import Target, add_terms_options, to_option
from adapters.mrs.cli.terminal import FAILED, connect

__all__ = ["FAILED", "Target", "add_terms_options", "connect", "to_option"]
