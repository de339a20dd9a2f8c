"""The sub-commands of `rover` that speak the MRS, each a module beside this face.

Other sub-commands and processes use `options` (`to_option`: where a rover is and on which terms;
`add_terms_options`: the terms of a process that serves) and `terminal`.
"""

from adapters.mrs.cli.options import RoverTarget as RoverTarget
from adapters.mrs.cli.options import add_terms_options as add_terms_options
from adapters.mrs.cli.options import json_option as json_option
from adapters.mrs.cli.options import to_option as to_option
from adapters.mrs.cli.options import to_options as to_options
from adapters.mrs.cli.terminal import FAILED as FAILED
from adapters.mrs.cli.terminal import clock as clock
from adapters.mrs.cli.terminal import connect as connect
from adapters.mrs.cli.terminal import echo_json as echo_json
from adapters.mrs.cli.terminal import run as run
from adapters.mrs.cli.terminal import say as say
