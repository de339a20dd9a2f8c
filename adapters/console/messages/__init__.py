"""What the console's server and its pages say to each other, as values; `encode` writes them.

Times are seconds since 1970-01-01 UTC; figures are in SI units and radians. The README of
`adapters.console` lists the messages. They stand on the standard library alone.
"""

from adapters.console.messages.commands import (
    ENDED,
    AuthorityHeld,
    CommandState,
    CommandStatus,
    StageReached,
)
from adapters.console.messages.pages import (
    PROTOCOL,
    DictionaryChanged,
    Hello,
    ObjectChanged,
    Presence,
    Present,
)
from adapters.console.messages.reports import (
    AlarmStatus,
    FileChanged,
    Notified,
    PlanProgress,
    Transfer,
    TransferState,
)
from adapters.console.messages.telemetry import (
    AssetState,
    Gap,
    Link,
    LinkState,
    LinkStatus,
    Quality,
    Sample,
    Scalar,
    TreeNode,
    TreeState,
)
from adapters.console.messages.wire import (
    Broadcast,
    Latest,
    Message,
    decode_command,
    decode_transfer,
    encode,
    is_wanted,
    plain,
    topic_of,
)

__all__ = [
    "ENDED",
    "PROTOCOL",
    "AlarmStatus",
    "AssetState",
    "AuthorityHeld",
    "Broadcast",
    "CommandState",
    "CommandStatus",
    "DictionaryChanged",
    "FileChanged",
    "Gap",
    "Hello",
    "Latest",
    "Link",
    "LinkState",
    "LinkStatus",
    "Message",
    "Notified",
    "ObjectChanged",
    "PlanProgress",
    "Presence",
    "Present",
    "Quality",
    "Sample",
    "Scalar",
    "StageReached",
    "Transfer",
    "TransferState",
    "TreeNode",
    "TreeState",
    "decode_command",
    "decode_transfer",
    "encode",
    "is_wanted",
    "plain",
    "topic_of",
]
