"""Starts a simulated rover as processes, allocates their addresses, and records their topics."""

from sim.processes.children import POLL_S as POLL_S
from sim.processes.children import ChildError as ChildError
from sim.processes.children import ProcessGroup as ProcessGroup
from sim.processes.console import OperationsConsole as OperationsConsole
from sim.processes.console import operations_console as operations_console
from sim.processes.deployment import Deployment as Deployment
from sim.processes.deployment import Orbiter as Orbiter
from sim.processes.deployment import Outage as Outage
from sim.processes.deployment import run_deployment as run_deployment
from sim.processes.deployment import run_relay as run_relay
from sim.processes.rover_address import ANY_PORT as ANY_PORT
from sim.processes.rover_address import HOST as HOST
from sim.processes.rover_address import AddressError as AddressError
from sim.processes.rover_address import RoverAddress as RoverAddress
from sim.processes.rover_address import allocate_address as allocate_address
from sim.processes.rover_address import default_address as default_address
