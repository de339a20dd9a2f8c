"""The client of the MRS: commands a rover and hears what it reports.

    MrsClient ─+─ queries, outcome, notification_stream, tree_stream, file_retrieval
               └─ session ── rover_consumer ── MAL: a connection for each address of the directory

`session` connects again after a loss, restores subscriptions, and gives up after `patience_s`. What
the rover answers as an error is raised as MalError; if it does not come back, ConnectionError.
"""

from adapters.mrs.ground.blocking import BlockingClient
from adapters.mrs.ground.client import SOURCE, CommandNumbers, MrsClient
from adapters.mrs.ground.file_retrieval import FileNews, TransferError
from adapters.mrs.ground.notification_stream import Stream
from adapters.mrs.ground.outcome import (
    DTN_OLDEST,
    DTN_QUEUED,
    LAST_HEARD,
    NEXT_CONTACT,
    OVERRIDE,
    TERMINAL,
    Outcome,
    describe_next_contact,
    where_stored,
)
from adapters.mrs.ground.rover_consumer import Dialer
from adapters.mrs.ground.session import UnknownHostError, parse_address

__all__ = [
    "DTN_OLDEST",
    "DTN_QUEUED",
    "LAST_HEARD",
    "NEXT_CONTACT",
    "OVERRIDE",
    "SOURCE",
    "TERMINAL",
    "BlockingClient",
    "CommandNumbers",
    "Dialer",
    "FileNews",
    "MrsClient",
    "Outcome",
    "Stream",
    "TransferError",
    "UnknownHostError",
    "describe_next_contact",
    "parse_address",
    "where_stored",
]
