"""The table of faults and their reactions, which an asset's YAML can change."""

from executive.faults.fault_declaration import FIGURES as FIGURES
from executive.faults.fault_declaration import ClearPolicy as ClearPolicy
from executive.faults.fault_declaration import Disproves as Disproves
from executive.faults.fault_declaration import FaultDeclaration as FaultDeclaration
from executive.faults.fault_declaration import FaultParameter as FaultParameter
from executive.faults.fault_declaration import FaultResponse as FaultResponse
from executive.faults.fault_declaration import MonitoredWhen as MonitoredWhen
from executive.faults.fault_declaration import Reaction as Reaction
from executive.faults.fault_declaration import Unmonitored as Unmonitored
from executive.faults.fault_declaration import Window as Window
from executive.faults.fault_declaration import summary as summary
from executive.faults.fault_table import DECLARED as DECLARED
from executive.faults.fault_table import FaultTable as FaultTable
