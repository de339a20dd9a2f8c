"""`change_noise` gives a simulated rover other noise from now on; constant errors remain."""

from collections.abc import Iterator

import numpy as np

from sim.checkpoint import Checkpointed
from sim.rover.instruments import NormalRows


def change_noise(rover: Checkpointed, seed: int) -> None:
    """Replace the random numbers of all parts of a rover that it has not drawn yet."""
    for number, part in enumerate(_sources(rover)):
        random = np.random.default_rng([seed, number])
        if isinstance(part, NormalRows):
            part.position = (random, 0)
        else:
            part.bit_generator.state = random.bit_generator.state


def _sources(value: object) -> Iterator[NormalRows | np.random.Generator]:
    if isinstance(value, NormalRows | np.random.Generator):
        yield value
    elif isinstance(value, Checkpointed):
        for name in value.CHANGES:
            yield from _sources(getattr(value, name))
    elif isinstance(value, list | tuple):
        for each in value:
            yield from _sources(each)
