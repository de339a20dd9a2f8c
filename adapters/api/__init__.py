"""Python API for scripts and notebooks: clients, requests, histories and recordings.

It only re-exports; the names in docs/python-api.md remain stable while the packages behind them
change.
"""

from adapters.explanation import Explanation as Explanation
from adapters.explanation import UnknownCommandError as UnknownCommandError
from adapters.explanation import explain_command as explain_command
from adapters.explanation import explain_now as explain_now
from adapters.explanation import explanation_lines as explanation_lines
from adapters.mal import Certificates as Certificates
from adapters.mal import MalError as MalError
from adapters.mrs.ground import BlockingClient as BlockingClient
from adapters.mrs.ground import CommandOutcome as CommandOutcome
from adapters.mrs.ground import MrsClient as MrsClient
from adapters.mrs.ground import ReceivedReport as ReceivedReport
from adapters.mrs.ground import ReceivedValue as ReceivedValue
from adapters.mrs.ground import Stream as Stream
from adapters.mrs.ground import TransferError as TransferError
from adapters.mrs.ground import UnknownHostError as UnknownHostError
from adapters.mrs.transport import TransportSettings as TransportSettings
from adapters.recording import RecordingError as RecordingError
from adapters.recording import frames as frames
from adapters.recording import read_history as read_history
from executive.commands import *  # noqa: F403  every request is in its catalogue
from executive.history import CommandHistory as CommandHistory
from executive.history import RunHistory as RunHistory
