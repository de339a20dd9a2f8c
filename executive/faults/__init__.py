"""Which faults there are, what is done about each, and how an asset's YAML changes that."""

from executive.faults.fault_declaration import FIGURES as FIGURES
from executive.faults.fault_declaration import Bound as Bound
from executive.faults.fault_declaration import Clears as Clears
from executive.faults.fault_declaration import Declaration as Declaration
from executive.faults.fault_declaration import Disproves as Disproves
from executive.faults.fault_declaration import Row as Row
from executive.faults.fault_declaration import Then as Then
from executive.faults.fault_declaration import When as When
from executive.faults.fault_declaration import Window as Window
from executive.faults.fault_table import DECLARED as DECLARED
from executive.faults.fault_table import FaultTable as FaultTable
