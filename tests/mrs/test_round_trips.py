"""Values of every type and every message of the MRS, in each encoding."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adapters.mal import Operation, Stage
from adapters.mal.binding import COMPOSITE, ELEMENT
from adapters.mal.specification import TypeRef
from adapters.mrs.spec.specification import mrs_specification
from tests.mal.round_trips import RoundTrips, name

TRIPS = RoundTrips(mrs_specification())
TYPES = [ref for ref in TRIPS.types if ref.area == "MRS" or ref in (COMPOSITE, ELEMENT)]


@pytest.mark.parametrize("ref", TYPES, ids=name)
@settings(max_examples=30)
@given(data=st.data())
def test_values_of_every_type_survive(ref: TypeRef, data: st.DataObject) -> None:
    TRIPS.values_of(ref, data)


@pytest.mark.parametrize("message", TRIPS.messages, ids=name)
@settings(max_examples=10)
@given(data=st.data())
def test_the_parts_of_every_message_survive(
    message: tuple[Operation, Stage], data: st.DataObject
) -> None:
    TRIPS.message(*message, data)
