"""Explanations of events and commands as text, computed from the `RunHistory` of a run.

All functions are pure. The input is a `RunHistory`: of a recording, of a running executive, or
from `MrsClient.get_history`. The output is an `Explanation` or the entries of a log.
"""

from adapters.explanation.explain import explain_command as explain_command
from adapters.explanation.explain import explain_now as explain_now
from adapters.explanation.explanation import Explanation as Explanation
from adapters.explanation.explanation import ExplanationStep as ExplanationStep
from adapters.explanation.explanation import UnknownCommandError as UnknownCommandError
from adapters.explanation.formatting import TimeFormatter as TimeFormatter
from adapters.explanation.formatting import entry_line as entry_line
from adapters.explanation.formatting import explanation_lines as explanation_lines
from adapters.explanation.log import Entry as Entry
from adapters.explanation.log import LogFilter as LogFilter
from adapters.explanation.log import entries as entries
from adapters.explanation.plan_steps import explain_node as explain_node
from adapters.explanation.selection import select_for as select_for
