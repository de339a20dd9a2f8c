"""The MRS provider of one executive: services that submit commands and publish its reports.

    consumer ==> served_operations ──> asset_services, … ──> gateway ==> the core's thread
      broker <== broadcast <────────────────+   <── post, futures <==========+

`gateway` passes commands and queries to the core. Everything else runs on the link's loop; the core
reaches it only through `gateway.post`.
"""

from adapters.mrs.aboard.asset_services import LAST_SEQUENCE as LAST_SEQUENCE
from adapters.mrs.aboard.asset_services import PAGE as PAGE
from adapters.mrs.aboard.asset_services import AssetServices as AssetServices
from adapters.mrs.aboard.asset_services import own_info as own_info
from adapters.mrs.aboard.asset_services import page_size as page_size
from adapters.mrs.aboard.asset_services import past_notifications as past_notifications
from adapters.mrs.aboard.asset_services import present_values as present_values
from adapters.mrs.aboard.asset_services import serve_commands as serve_commands
from adapters.mrs.aboard.file_services import FileServices as FileServices
from adapters.mrs.aboard.gateway import CoreGateway as CoreGateway
from adapters.mrs.aboard.plan_check_service import PlanCheckService as PlanCheckService
from adapters.mrs.aboard.query_services import HistoryService as HistoryService
from adapters.mrs.aboard.query_services import PreviewService as PreviewService
from adapters.mrs.aboard.query_services import TreeService as TreeService
from adapters.mrs.aboard.query_services import serve_authority as serve_authority
from adapters.mrs.aboard.served_operations import ServedOperations as ServedOperations
