"""What every type and every message of a specification must do: come back as they were written."""

from typing import Any

import pytest
from hypothesis import strategies as st

from adapters.mal import Codec, DecodeError, Encoding, Field, Operation, Specification, Stage
from adapters.mal.specification import TypeRef
from tests.mal.strategies import Strategies


class RoundTrips:
    """Takes values through all encodings, those of one specification."""

    def __init__(self, specification: Specification) -> None:
        self.strategies = Strategies(specification)
        self.types = self.strategies.types
        self.messages: list[tuple[Operation, Stage]] = [
            (operation, stage)
            for area in specification.areas
            for service in area.services
            for operation in service.operations
            for stage in operation.parts
        ]
        self._codecs = [Codec(specification, encoding) for encoding in Encoding]

    def values_of(self, ref: TypeRef, data: st.DataObject) -> None:
        """Send values of a type: alone, as a list, NULL and not, beside something else."""
        as_list = TypeRef(ref.area, ref.name, is_list=True)
        boolean = TypeRef("MAL", "Boolean")
        parts = (
            Field("before", boolean),
            Field("value", ref),
            Field("nullable", ref, nullable=True),
            Field("list", as_list),
            Field("nullableList", as_list, nullable=True),
            Field("after", boolean),
        )
        self._through(parts, data)

    def message(self, operation: Operation, stage: Stage, data: st.DataObject) -> None:
        """Send the parts of a message."""
        self._through(operation.parts[stage], data)

    def _through(self, parts: tuple[Field, ...], data: st.DataObject) -> None:
        values: tuple[Any, ...] = data.draw(
            st.tuples(*(self.strategies.field(part) for part in parts))
        )
        for codec in self._codecs:
            body = codec.encode(parts, values)
            back = codec.decode(parts, body)
            assert back == values
            assert repr(back) == repr(values)
            wrongs = [body + b"\0"] + ([body[:-1]] if body else [])
            for wrong in wrongs:
                with pytest.raises(DecodeError):
                    codec.decode(parts, wrong)


def name(case: Any) -> str:
    """Tell a case by name."""
    if isinstance(case, TypeRef):
        return f"{case.area}.{case.name}"
    operation, stage = case
    return f"{operation.service_name}.{operation.name}-{stage.name}"
