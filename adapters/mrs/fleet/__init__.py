"""Several assets: the directory, what was heard of others, the service layer above.

Every executive is a service layer where other assets register and publish, and may be registered at
one itself. docs/mrs-rules.md lists what is stored, bounded and passed on.
"""

from adapters.mrs.fleet.fleet_service import FleetService as FleetService
