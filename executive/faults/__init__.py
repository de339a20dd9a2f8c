"""Which faults there are, what is done about each, and how an asset's YAML changes that."""

from executive.faults.fault_declaration import (
    FIGURES,
    Bound,
    Clears,
    Declaration,
    Disproves,
    Row,
    Then,
    When,
    Window,
)
from executive.faults.fault_table import DECLARED, FaultTable

__all__ = [
    "DECLARED",
    "FIGURES",
    "Bound",
    "Clears",
    "Declaration",
    "Disproves",
    "FaultTable",
    "Row",
    "Then",
    "When",
    "Window",
]
