"""Handlers of the console's HTTP requests, which the README of `adapters.console` lists.

Each class `...Requests` has the handlers of one subject, which its `routes()` returns. They share
`Commanding`, `Transfers` and `FileStore`, respond through `adapters.console.web`, and command
through `adapters.console.rovers`.
"""

from adapters.console.requests.alarms import AlarmRequests as AlarmRequests
from adapters.console.requests.commanding import Commanding as Commanding
from adapters.console.requests.drafts import DraftRequests as DraftRequests
from adapters.console.requests.explaining import ExplanationRequests as ExplanationRequests
from adapters.console.requests.export import ExportRequests as ExportRequests
from adapters.console.requests.file_store import FileStore as FileStore
from adapters.console.requests.files import FileRequests as FileRequests
from adapters.console.requests.forks import ForkRequests as ForkRequests
from adapters.console.requests.history import ArchiveRequests as ArchiveRequests
from adapters.console.requests.map_requests import MapRequests as MapRequests
from adapters.console.requests.objects import PlanRequests as PlanRequests
from adapters.console.requests.objects import SharedObjectRequests as SharedObjectRequests
from adapters.console.requests.operations import OperationRequests as OperationRequests
from adapters.console.requests.plan_checks import PlanCheckRequests as PlanCheckRequests
from adapters.console.requests.stops import Stops as Stops
from adapters.console.requests.transfers import Transfers as Transfers
from adapters.console.requests.video import VideoRequests as VideoRequests
