"""The provider of the MRS: serves one executive."""

from adapters.mrs.aboard.command_service import serve_commands
from adapters.mrs.aboard.file_services import FileManagementService, serve_files
from adapters.mrs.aboard.gateway import Gateway
from adapters.mrs.aboard.notification_service import (
    LAST_SEQUENCE,
    PAGE,
    NotificationService,
    page_size,
    past_notifications,
    serve_events,
)
from adapters.mrs.aboard.plan_service import PlanService
from adapters.mrs.aboard.served_operations import ServedOperations
from adapters.mrs.aboard.status_service import MonitoringService, present_values, serve_state

__all__ = [
    "LAST_SEQUENCE",
    "PAGE",
    "FileManagementService",
    "Gateway",
    "MonitoringService",
    "NotificationService",
    "PlanService",
    "ServedOperations",
    "page_size",
    "past_notifications",
    "present_values",
    "serve_commands",
    "serve_events",
    "serve_files",
    "serve_state",
]
