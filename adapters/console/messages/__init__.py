"""Messages between the console's server and its pages, as values; `encode` converts them to JSON.

Times are seconds since 1970-01-01 UTC; figures are in SI units and radians. The README of
`adapters.console` lists the messages. The package imports the standard library only.
"""

from adapters.console.messages.commands import TERMINAL_STATES as TERMINAL_STATES
from adapters.console.messages.commands import AuthorityMessage as AuthorityMessage
from adapters.console.messages.commands import CommandState as CommandState
from adapters.console.messages.commands import CommandStatus as CommandStatus
from adapters.console.messages.commands import StageEntry as StageEntry
from adapters.console.messages.commands import StopState as StopState
from adapters.console.messages.commands import StopStatus as StopStatus
from adapters.console.messages.pages import PROTOCOL as PROTOCOL
from adapters.console.messages.pages import DictionaryChanged as DictionaryChanged
from adapters.console.messages.pages import Hello as Hello
from adapters.console.messages.pages import ObjectChanged as ObjectChanged
from adapters.console.messages.pages import OpenPage as OpenPage
from adapters.console.messages.pages import Presence as Presence
from adapters.console.messages.reports import AlarmStatus as AlarmStatus
from adapters.console.messages.reports import FileChanged as FileChanged
from adapters.console.messages.reports import NotificationMessage as NotificationMessage
from adapters.console.messages.reports import PlanProgress as PlanProgress
from adapters.console.messages.reports import QuestionStatus as QuestionStatus
from adapters.console.messages.reports import Transfer as Transfer
from adapters.console.messages.reports import TransferState as TransferState
from adapters.console.messages.telemetry import AssetState as AssetState
from adapters.console.messages.telemetry import LinkKind as LinkKind
from adapters.console.messages.telemetry import LinkState as LinkState
from adapters.console.messages.telemetry import LinkStatus as LinkStatus
from adapters.console.messages.telemetry import PosePrediction as PosePrediction
from adapters.console.messages.telemetry import Quality as Quality
from adapters.console.messages.telemetry import Sample as Sample
from adapters.console.messages.telemetry import SamplesDropped as SamplesDropped
from adapters.console.messages.telemetry import Scalar as Scalar
from adapters.console.messages.telemetry import TreeFault as TreeFault
from adapters.console.messages.telemetry import TreeNode as TreeNode
from adapters.console.messages.telemetry import TreeState as TreeState
from adapters.console.messages.wire import Broadcast as Broadcast
from adapters.console.messages.wire import Latest as Latest
from adapters.console.messages.wire import Message as Message
from adapters.console.messages.wire import decode_command as decode_command
from adapters.console.messages.wire import decode_transfer as decode_transfer
from adapters.console.messages.wire import encode as encode
from adapters.console.messages.wire import is_wanted as is_wanted
from adapters.console.messages.wire import plain as plain
from adapters.console.messages.wire import topic_of as topic_of
