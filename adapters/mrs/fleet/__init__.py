"""Several assets: the directory, what was heard of others, the service layer above."""

from adapters.mrs.fleet.fleet_service import FleetService

__all__ = ["FleetService"]
