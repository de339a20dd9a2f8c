"""`Checkpointed`: parts of a simulation with a state that another process can continue.

A part declares the attributes that change; all others follow from the arguments of its constructor.
A checkpoint is JSON: recordings can be of any origin, and reading one executes nothing.
"""

import json
from collections.abc import Mapping
from typing import Any, ClassVar, Final

import numpy as np
from cattrs import Converter
from cattrs.strategies import configure_tagged_union

from executive.values.facts import Fact

CONVERTER: Final = Converter(detailed_validation=False, forbid_extra_keys=True)
"""Converts values to JSON and back, to the last bit."""
configure_tagged_union(Fact, CONVERTER, tag_name="kind")


class CheckpointError(ValueError):
    """A text is no checkpoint of this simulation; the text gives the reason."""


@CONVERTER.register_unstructure_hook
def _plain_random(random: np.random.Generator) -> list[int]:
    state: Any = random.bit_generator.state
    return [*state["state"].values(), state["has_uint32"], state["uinteger"]]


@CONVERTER.register_structure_hook
def _random(raw: Any, _: type[np.random.Generator]) -> np.random.Generator:
    state, increment, has_uint32, uinteger = map(int, raw)
    bits = np.random.PCG64(0)
    bits.state = {
        **bits.state,
        "state": {"state": state, "inc": increment},
        "has_uint32": has_uint32,
        "uinteger": uinteger,
    }
    return np.random.Generator(bits)


def changing(base: "type[Checkpointed] | None" = None, /, **kinds: Any) -> Mapping[str, Any]:
    """Return the attributes that change, and their types, after those of a base class."""
    return kinds if base is None else {**base.CHANGES, **kinds}


class Checkpointed:
    """A part of a simulation, perhaps of further parts.

    Attributes:
        CHANGES: the attributes that change, in the order of restoring, and their types;
            `Checkpointed` for a part, several parts, or None.
    """

    CHANGES: ClassVar[Mapping[str, Any]] = changing()

    def save(self) -> str:
        """Return the state of this part and its parts."""
        return json.dumps(_saved(self), separators=(",", ":"))

    def restore(self, text: str) -> None:
        """Continue from a saved state, in a new object made by the same arguments.

        Raises:
            CheckpointError: the text is damaged, or of another version or kind of rover. The object
                is then not to be used.
        """
        try:
            _restore(self, json.loads(text))
        except (ValueError, TypeError, LookupError, ArithmeticError, RecursionError) as error:
            raise CheckpointError(
                f"the recorded state of the simulation is damaged or of another version: {error}"
            ) from error


def _saved(part: Checkpointed | tuple[Checkpointed, ...] | None) -> Any:
    if part is None:
        return None
    if isinstance(part, tuple):
        return [_saved(each) for each in part]
    return [
        _saved(getattr(part, name))
        if kind is Checkpointed
        else CONVERTER.unstructure(getattr(part, name), kind)
        for name, kind in part.CHANGES.items()
    ]


def _restore(part: Checkpointed | tuple[Checkpointed, ...] | None, saved: Any) -> None:
    if part is None:
        if saved is not None:
            raise ValueError("it has parts that this rover has not")
    elif isinstance(part, tuple):
        for each, raw in zip(part, saved, strict=True):
            _restore(each, raw)
    else:
        for (name, kind), raw in zip(part.CHANGES.items(), saved, strict=True):
            if kind is Checkpointed:
                _restore(getattr(part, name), raw)
            else:
                setattr(part, name, CONVERTER.structure(raw, kind))
