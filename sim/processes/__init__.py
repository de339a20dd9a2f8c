"""A simulated rover as processes: start, end, address, recording."""

from sim.processes.children import LOOK_S as LOOK_S
from sim.processes.children import ChildError as ChildError
from sim.processes.children import ProcessGroup as ProcessGroup
from sim.processes.console import OperationsConsole as OperationsConsole
from sim.processes.console import operations_console as operations_console
from sim.processes.contacts import Outage as Outage
from sim.processes.deployment import Deployment as Deployment
from sim.processes.deployment import deployed as deployed
from sim.processes.place import ANY_PORT as ANY_PORT
from sim.processes.place import HOST as HOST
from sim.processes.place import AddressError as AddressError
from sim.processes.place import RoverAddress as RoverAddress
from sim.processes.place import free_place as free_place
from sim.processes.place import known_place as known_place
