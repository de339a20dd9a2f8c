"""The requests of pages and programs, which the README of `adapters.console` lists.

Each module has the handlers of one subject, as `routes()`. They answer by `adapters.console.web`
and command by `adapters.console.rovers`.
"""

from adapters.console.requests.alarms import Alarms
from adapters.console.requests.commanding import Commanding
from adapters.console.requests.explaining import Explaining
from adapters.console.requests.export import Export
from adapters.console.requests.file_store import FileStore
from adapters.console.requests.files import Files
from adapters.console.requests.history import History
from adapters.console.requests.objects import Objects
from adapters.console.requests.operations import Operations
from adapters.console.requests.plans import Plans
from adapters.console.requests.transfers import Transfers
from adapters.console.requests.video import Video

__all__ = [
    "Alarms",
    "Commanding",
    "Explaining",
    "Export",
    "FileStore",
    "Files",
    "History",
    "Objects",
    "Operations",
    "Plans",
    "Transfers",
    "Video",
]
