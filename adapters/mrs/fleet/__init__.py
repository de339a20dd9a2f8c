"""An executive as service layer of several assets: their directory, their data, a layer upstream.

Every executive is a service layer where other assets register and publish, and can register at
another one itself. docs/mrs-rules.md lists the stored data, its bounds and the forwarding.
"""

from adapters.mrs.fleet.fleet_service import FleetService as FleetService
