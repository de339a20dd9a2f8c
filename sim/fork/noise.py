"""`change_noise` gives a simulated rover other noise from now on; constant errors remain."""

from collections.abc import Iterator
from itertools import count

import numpy as np

from sim.checkpoint import Checkpointed


def change_noise(rover: Checkpointed, seed: int) -> None:
    """Replace the random numbers that a rover and its parts have not drawn yet."""
    numbers = count()
    for part in _parts(rover):
        for name in part.CHANGES:
            match getattr(part, name):
                case np.random.Generator() as random:
                    other = np.random.default_rng([seed, next(numbers)])
                    random.bit_generator.state = other.bit_generator.state
                case (np.random.Generator(), int()):
                    setattr(part, name, (np.random.default_rng([seed, next(numbers)]), 0))
                case _:
                    pass


def _parts(part: Checkpointed) -> Iterator[Checkpointed]:
    yield part
    for value in (getattr(part, name) for name in part.CHANGES):
        for each in value if isinstance(value, list | tuple) else (value,):
            if isinstance(each, Checkpointed):
                yield from _parts(each)
