"""Sub-commands of `rover` that use the MRS, one module each.

Other sub-commands and processes use `terminal` and `options`: `to_option` for the address,
encoding and certificates of a rover, `add_terms_options` for those of a server process.
"""

from adapters.mrs.cli.options import QuantityType as QuantityType
from adapters.mrs.cli.options import RoverTarget as RoverTarget
from adapters.mrs.cli.options import add_terms_options as add_terms_options
from adapters.mrs.cli.options import json_option as json_option
from adapters.mrs.cli.options import to_option as to_option
from adapters.mrs.cli.options import to_options as to_options
from adapters.mrs.cli.terminal import FAILED as FAILED
from adapters.mrs.cli.terminal import command_numbers as command_numbers
from adapters.mrs.cli.terminal import completion as completion
from adapters.mrs.cli.terminal import connect as connect
from adapters.mrs.cli.terminal import echo_json as echo_json
from adapters.mrs.cli.terminal import echo_line as echo_line
from adapters.mrs.cli.terminal import run as run
