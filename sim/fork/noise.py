"""`change_noise` gives a simulated rover other noise from now on; constant errors remain."""

from itertools import count

import numpy as np

from sim.checkpoint import Checkpointed


def change_noise(rover: Checkpointed, seed: int) -> None:
    """Replace the random numbers that a rover and its parts have not drawn yet."""
    numbers, parts = count(), [rover]
    for part in parts:
        for name in part.CHANGES:
            value = getattr(part, name)
            match value:
                case np.random.Generator() as random:
                    other = np.random.default_rng([seed, next(numbers)])
                    random.bit_generator.state = other.bit_generator.state
                case (np.random.Generator(), int()):
                    setattr(part, name, (np.random.default_rng([seed, next(numbers)]), 0))
                case _:
                    values = value if isinstance(value, list | tuple) else (value,)
                    parts += [each for each in values if isinstance(each, Checkpointed)]
