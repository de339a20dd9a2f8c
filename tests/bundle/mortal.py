"""An application beside a node that may die: it counts as sent what the node has on its disk."""

from tests.bundle.weather import Side, World


class Mortal:
    """Puts numbered messages in at random times.

    Attributes:
        put: those that the node said it has.
    """

    def __init__(self, world: World, side: Side, count: int, until_s: float) -> None:
        self.side = side
        self.put: list[bytes] = []
        self._number = 0
        for _ in range(count):
            world.at(world.chance.uniform(0.0, until_s), self._put)

    def _put(self) -> None:
        payload = b"%d-%06d" % (self.side.number, self._number)
        self._number += 1
        self.side.put(payload)
        self.side.node.transaction.then(lambda failure: self._count(payload, failure))

    def _count(self, payload: bytes, failure: object) -> None:
        if failure is None:
            self.put.append(payload)
