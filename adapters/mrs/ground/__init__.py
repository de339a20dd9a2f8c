"""Client of the MRS: commands a rover and receives its reports.

    MrsClient ─+─ queries, outcome, streams, file_retrieval
               └─ session ── rover_consumer ── MAL: a connection for each address of the directory

`session` reconnects after a loss and restores subscriptions, for at most `patience_s`. An error
answer of the rover is raised as MalError; a rover that stays lost, as ConnectionError.
"""

from adapters.mrs.ground.blocking import BlockingClient as BlockingClient
from adapters.mrs.ground.client import CommandIdGenerator as CommandIdGenerator
from adapters.mrs.ground.client import MrsClient as MrsClient
from adapters.mrs.ground.file_retrieval import FileNotification as FileNotification
from adapters.mrs.ground.file_retrieval import TransferError as TransferError
from adapters.mrs.ground.file_retrieval import checksum_of as checksum_of
from adapters.mrs.ground.outcome import DTN_OLDEST_AGE as DTN_OLDEST_AGE
from adapters.mrs.ground.outcome import DTN_QUEUED as DTN_QUEUED
from adapters.mrs.ground.outcome import LAST_RECEIVED as LAST_RECEIVED
from adapters.mrs.ground.outcome import NEXT_CONTACT as NEXT_CONTACT
from adapters.mrs.ground.outcome import OVERRIDE as OVERRIDE
from adapters.mrs.ground.outcome import CommandOutcome as CommandOutcome
from adapters.mrs.ground.outcome import describe_next_contact as describe_next_contact
from adapters.mrs.ground.outcome import describe_storage as describe_storage
from adapters.mrs.ground.rover_consumer import Dialer as Dialer
from adapters.mrs.ground.session import LinkDelay as LinkDelay
from adapters.mrs.ground.session import UnknownHostError as UnknownHostError
from adapters.mrs.ground.session import parse_address as parse_address
from adapters.mrs.ground.streams import Stream as Stream
from adapters.mrs.spec import ReceivedReport as ReceivedReport
from adapters.mrs.spec import ReceivedValue as ReceivedValue
