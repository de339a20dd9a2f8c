"""Every type and every message of a specification survives each encoding."""

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from adapters.mal import Codec, DecodeError, Encoding, Field, InteractionStage, Operation
from adapters.mal.specification import TypeRef
from tests.mal.strategies import Strategies
from tests.mal.wiretest import SPECIFICATION
from tests.support.examples import examples

STRATEGIES = Strategies(SPECIFICATION)
MESSAGES = [
    (operation, stage)
    for area in SPECIFICATION.areas
    for service in area.services
    for operation in service.operations
    for stage in operation.parts
]
CODECS = [Codec(SPECIFICATION, encoding) for encoding in Encoding]
BOOLEAN = TypeRef("MAL", "Boolean")


def name(case: Any) -> str:
    if isinstance(case, TypeRef):
        return f"{case.area}.{case.name}"
    operation, stage = case
    return f"{operation.service_name}.{operation.name}-{stage.name}"


def assert_survives(parts: tuple[Field, ...], data: st.DataObject) -> None:
    values: tuple[Any, ...] = data.draw(st.tuples(*map(STRATEGIES.field, parts)))
    for codec in CODECS:
        body = codec.encode(parts, values)
        back = codec.decode(parts, body)
        assert back == values
        assert repr(back) == repr(values)
        for wrong in [body + b"\0"] + ([body[:-1]] if body else []):
            with pytest.raises(DecodeError):
                codec.decode(parts, wrong)


@pytest.mark.parametrize("ref", STRATEGIES.types, ids=name)
@settings(max_examples=examples(30))
@given(data=st.data())
def test_values_of_every_type_survive(ref: TypeRef, data: st.DataObject) -> None:
    """Alone, as a list, NULL and not, beside something else."""
    as_list = TypeRef(ref.area, ref.name, is_list=True)
    parts = (
        Field("before", BOOLEAN),
        Field("value", ref),
        Field("nullable", ref, nullable=True),
        Field("list", as_list),
        Field("nullableList", as_list, nullable=True),
        Field("after", BOOLEAN),
    )
    assert_survives(parts, data)


@pytest.mark.parametrize("message", MESSAGES, ids=name)
@settings(max_examples=examples(10))
@given(data=st.data())
def test_the_parts_of_every_message_survive(
    message: tuple[Operation, InteractionStage], data: st.DataObject
) -> None:
    operation, stage = message
    assert_survives(operation.parts[stage], data)
