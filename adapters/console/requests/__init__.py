"""The requests of pages and programs, which the README of `adapters.console` lists.

Each module has the handlers of one subject, as `routes()`. They answer by `adapters.console.web`
and command by `adapters.console.rovers`.
"""

from adapters.console.requests.alarms import Alarms as Alarms
from adapters.console.requests.commanding import Commanding as Commanding
from adapters.console.requests.explaining import Explaining as Explaining
from adapters.console.requests.export import Export as Export
from adapters.console.requests.file_store import FileStore as FileStore
from adapters.console.requests.files import Files as Files
from adapters.console.requests.history import History as History
from adapters.console.requests.objects import Objects as Objects
from adapters.console.requests.operations import Operations as Operations
from adapters.console.requests.plans import Plans as Plans
from adapters.console.requests.transfers import Transfers as Transfers
from adapters.console.requests.video import Video as Video
