"""`Simulation`: the description of a simulation in a recording, and the changes of its faults."""

import json
from dataclasses import dataclass, field

from executive.core.recording import SimulatedFaultChanged, SimulationStarted
from executive.settings import structure, unstructure
from sim.rover.camera import PictureSettings
from sim.rover.faults import SimulatedFault, fault_declaration, format_fault, read_fault
from sim.rover.jackal import SimulatedOdometry
from sim.rover.world import World


@dataclass(frozen=True, slots=True)
class Simulation:
    """The properties of a simulation that the settings of the asset do not define.

    Attributes:
        seed: seed of all sensor noise.
        odometry: accuracy of a Jackal's odometry.
    """

    world: World
    seed: int = 0
    odometry: SimulatedOdometry = field(default_factory=SimulatedOdometry)
    picture: PictureSettings = field(default_factory=PictureSettings)

    def started(self, time_s: float) -> SimulationStarted:
        """Return the item of a recording that describes it."""
        return SimulationStarted(time_s, json.dumps(unstructure(self)))

    @classmethod
    def of(cls, item: SimulationStarted) -> "Simulation":
        """Return the simulation of an item.

        Raises:
            ValueError: the text is not valid, for example of another version.
        """
        return structure(json.loads(item.text), cls, "/sim/world of the recording")


def fault_changed(
    time_s: float, kind: type[SimulatedFault], begins: SimulatedFault | None
) -> SimulatedFaultChanged:
    """Return the item of a recording for a fault that begins, or for a kind that is cleared."""
    written = fault_declaration(kind).name if begins is None else format_fault(begins)
    return SimulatedFaultChanged(time_s, begins is not None, json.dumps(written))


def fault_of(item: SimulatedFaultChanged) -> SimulatedFault:
    """Return the fault of an item; only its class matters if it was cleared.

    Raises:
        ValueError: there is no such fault.
    """
    return read_fault(json.loads(item.text))
