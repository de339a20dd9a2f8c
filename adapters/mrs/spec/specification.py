"""The MRS as an MO specification, from which provider and client are driven."""

from functools import cache
from pathlib import Path
from typing import Final

from adapters.mal import Specification, load_specification
from adapters.mrs.spec import types

MRS_XML: Final = Path(__file__).with_name("mrs.xml")


@cache
def mrs_specification() -> Specification:
    """Return the specification, bound to the classes of `adapters.mrs.spec.types`."""
    return load_specification(MRS_XML, types)
