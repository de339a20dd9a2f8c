"""Bodies: the parts of a message to octets and back, driven by the specification."""

from collections.abc import Sequence
from typing import Any, Final

from adapters.mal.encoding import Encoding
from adapters.mal.errors import DecodeError, EncodeError, MalError
from adapters.mal.reader import READERS
from adapters.mal.specification import Field, Specification, TypeRef
from adapters.mal.type_codec import Codes, TypeCodec, write_named
from adapters.mal.writer import WRITERS

ERROR_PARTS: Final = (
    Field("number", TypeRef("MAL", "UInteger")),
    Field("extraInformation", TypeRef("MAL", "Element"), nullable=True),
)
"""The parts of every error."""


class Codec:
    """Encodes and decodes bodies of one specification in one encoding."""

    def __init__(self, specification: Specification, encoding: Encoding = Encoding.FIXED) -> None:
        """Prepare; the work for each message is done when it is first met."""
        self._reader = READERS[encoding]
        self._writer = WRITERS[encoding]
        self._types = TypeCodec(specification, self._reader, self._writer)
        self._codes: dict[tuple[Field, ...], tuple[Codes, ...]] = {}

    def decode(self, parts: tuple[Field, ...], body: bytes) -> tuple[Any, ...]:
        """Read the parts of a message.

        Raises:
            DecodeError: The body is not exactly one value of each part.
        """
        if not parts:
            if body:
                raise DecodeError(f"{len(body)} octets where no part is")
            return ()
        reader = self._reader(body)
        values = []
        for codes, part in zip(self._codes_of(parts), parts, strict=True):
            try:
                values.append(codes.read(reader))
            except DecodeError as fault:
                raise DecodeError(f"{part.name}: {fault}") from None
        reader.finish()
        return tuple(values)

    def encode(self, parts: tuple[Field, ...], values: Sequence[Any]) -> bytes:
        """Write the parts of a message.

        Raises:
            EncodeError: A value does not fit its part, or there are too many or too few.
        """
        if len(values) != len(parts):
            raise EncodeError(f"{len(parts)} parts wanted, {len(values)} given")
        if not parts:
            return b""
        writer = self._writer()
        for codes, part, value in zip(self._codes_of(parts), parts, values, strict=True):
            write_named(part.name, codes.write, writer, value)
        return writer.finish()

    def decode_error(self, body: bytes) -> MalError:
        """Read the body of a message whose is-error bit is set.

        Raises:
            DecodeError: The body is not an error's.
        """
        return MalError(*self.decode(ERROR_PARTS, body))

    def encode_error(self, error: MalError) -> bytes:
        """Write the body of an error.

        Raises:
            EncodeError: The number or the extra information does not fit.
        """
        return self.encode(ERROR_PARTS, (error.number, error.extra))

    def _codes_of(self, parts: tuple[Field, ...]) -> tuple[Codes, ...]:
        codes = self._codes.get(parts)
        if codes is None:
            codes = self._codes[parts] = tuple(self._types.part(part) for part in parts)
        return codes
