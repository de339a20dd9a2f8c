"""Values of every type of the MAL and of the captured messages' specification, in each encoding."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adapters.mal import Operation, Stage
from adapters.mal.specification import TypeRef
from tests.mal.round_trips import RoundTrips, name
from tests.mal.wiretest import SPECIFICATION

TRIPS = RoundTrips(SPECIFICATION)


@pytest.mark.parametrize("ref", TRIPS.types, ids=name)
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
