"""Files of captured messages, each with the value it carries, and their specification."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from adapters.mal.errors import SpecificationError
from adapters.mal.specification import Specification
from adapters.mal.vector_specification import read_test_specification


class VectorFileError(ValueError):
    """A file is no vector file."""


@dataclass(frozen=True, slots=True)
class Vector:
    """One captured message. What is not given is not compared; nothing in it is checked yet.

    Attributes:
        label: What to call it in a report.
        encoding: Name of the body encoding.
        message: The whole message, in hex.
        given: The other members of the JSON object: header, headerLength, body, value.
    """

    label: str
    encoding: str
    message: Any
    given: dict[str, Any]


@dataclass(frozen=True, slots=True)
class VectorFile:
    """The specification of a vector file, and its vectors."""

    specification: Specification
    vectors: tuple[Vector, ...]


def load_vectors(path: Path) -> VectorFile:
    """Read a vector file.

    Raises:
        VectorFileError: It cannot be read, or is no vector file; one line says why.
    """
    try:
        data = json.loads(path.read_bytes())
    except OSError as fault:
        raise VectorFileError(f"{path}: {fault.strerror}") from fault
    except (ValueError, RecursionError) as fault:
        raise VectorFileError(f"{path}: not JSON: {fault}") from fault
    if not isinstance(data, dict) or not isinstance(data.get("vectors"), list):
        raise VectorFileError(f"{path}: no list of vectors")
    if "testSpecification" not in data:
        raise VectorFileError(f"{path}: no testSpecification")
    if not all(isinstance(vector, dict) for vector in data["vectors"]):
        raise VectorFileError(f"{path}: a vector is no object")
    try:
        specification = read_test_specification(data["testSpecification"])
    except SpecificationError as fault:
        raise VectorFileError(f"{path}: {fault}") from fault
    return VectorFile(
        specification, tuple(_vector(i, vector) for i, vector in enumerate(data["vectors"]))
    )


def _vector(index: int, data: dict[str, Any]) -> Vector:
    words = [str(data[name]) for name in ("encoding", "sender", "case", "stage") if name in data]
    return Vector(
        f"{index} {' '.join(words)}", str(data.get("encoding")), data.get("message"), dict(data)
    )
