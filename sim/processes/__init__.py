"""A simulated rover as processes: started and ended, found, listened to."""

from sim.processes.children import LOOK_S, ChildError, ProcessGroup
from sim.processes.console import OperationsConsole, operations_console
from sim.processes.contacts import Eclipse
from sim.processes.deployment import Deployment, deployed
from sim.processes.place import ANY_PORT, HOST, Place, PlaceError, free_place, known_place

__all__ = [
    "ANY_PORT",
    "HOST",
    "LOOK_S",
    "ChildError",
    "Deployment",
    "Eclipse",
    "OperationsConsole",
    "Place",
    "PlaceError",
    "ProcessGroup",
    "deployed",
    "free_place",
    "known_place",
    "operations_console",
]
