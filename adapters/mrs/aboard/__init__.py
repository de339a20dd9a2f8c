"""The provider of the MRS: serves one executive.

    consumer ==> served_operations ──> asset_services, … ──> gateway ==> the core's thread
      broker <== broadcast <────────────────+   <── post, futures <==========+

`gateway` hands commands and questions to the core; `gateway.post` is the one way back to the link's
loop, on which all else runs.
"""

from adapters.mrs.aboard.asset_services import (
    LAST_SEQUENCE,
    PAGE,
    AssetServices,
    own_info,
    page_size,
    past_notifications,
    present_values,
    serve_commands,
)
from adapters.mrs.aboard.authority_service import serve_authority
from adapters.mrs.aboard.file_services import FileServices
from adapters.mrs.aboard.gateway import Gateway
from adapters.mrs.aboard.history_service import HistoryService
from adapters.mrs.aboard.preview_service import PreviewService
from adapters.mrs.aboard.served_operations import ServedOperations
from adapters.mrs.aboard.tree_service import TreeService

__all__ = [
    "LAST_SEQUENCE",
    "PAGE",
    "AssetServices",
    "FileServices",
    "Gateway",
    "HistoryService",
    "PreviewService",
    "ServedOperations",
    "TreeService",
    "own_info",
    "page_size",
    "past_notifications",
    "present_values",
    "serve_authority",
    "serve_commands",
]
