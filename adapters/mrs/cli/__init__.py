"""The sub-commands of `rover` that speak the MRS, each a module beside this face.

Other sub-commands and processes use `options` (`to_option`: where a rover is and on which terms;
`add_terms_options`: the terms of a process that serves) and `terminal`.
"""

from adapters.mrs.cli.options import Target, add_terms_options, json_option, to_option, to_options
from adapters.mrs.cli.terminal import FAILED, clock, connect, echo_json, run, say

__all__ = [
    "FAILED",
    "Target",
    "add_terms_options",
    "clock",
    "connect",
    "echo_json",
    "json_option",
    "run",
    "say",
    "to_option",
    "to_options",
]
