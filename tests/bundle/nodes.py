"""Nodes joined by hand, in simulated time."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

from adapters.bundle.codec.eid import Eid, Ipn
from adapters.bundle.codec.errors import StoreError
from adapters.bundle.node.database import BundleDatabase, StoreLimits
from adapters.bundle.node.node import BundleNode
from adapters.bundle.node.reporting import DeliveryNotice, DeliveryStatus
from adapters.bundle.node.security import Security
from adapters.bundle.node.settings import Address, LtpLink, Neighbour, NodeSettings
from tests.support.unsynced import UNSYNCED

NOWHERE = LtpLink(Address("127.0.0.1", 1))
START_UTC_MS = 1_800_000_000_000


class Clock:
    """Wall clock in the hands of the test."""

    def __init__(self) -> None:
        self.utc_ms = START_UTC_MS

    def __call__(self) -> int:
        return self.utc_ms


def settings_of(number: int, *neighbours: int, **others: object) -> NodeSettings:
    """Return the settings of ipn:<number>, whose first neighbour reaches all others."""
    return NodeSettings(
        sender=Ipn(number, 1),
        receivers=(Ipn(number, 1), Ipn(number, 2)),
        neighbours=tuple(
            Neighbour(Ipn(other, 0), NOWHERE, default=not index)
            for index, other in enumerate(neighbours)
        ),
        **others,  # type: ignore[arg-type]
    )


class TestedNode:
    """A node with its store in a folder; what it told and what was fetched from it."""

    __test__ = False

    def __init__(
        self,
        folder: Path,
        settings: NodeSettings,
        clock: Clock,
        limits: StoreLimits | None = None,
        security: Security | None = None,
    ) -> None:
        self.path = folder / f"{settings.node}.db"
        self.settings, self.clock, self.limits = settings, clock, limits
        self.security = security
        self.notices: list[DeliveryNotice] = []
        self.start()

    def start(self) -> None:
        self.database = BundleDatabase(self.path, self.limits, UNSYNCED)
        self.node = BundleNode(
            self.settings, self.database, self.clock, self.notices.append, self.security
        )

    def restart(self) -> None:
        """Die as by kill -9 and start again."""
        self.database.close()
        self.start()

    def put(self, destination: Eid, payload: bytes, **options: object) -> str:
        identity = self.node.put(destination, payload, **options)  # type: ignore[arg-type]
        self.commit()
        return str(identity)

    def commit(self) -> StoreError | None:
        failures: list[StoreError | None] = []
        self.node.transaction.on_commit(failures.append)
        self.node.transaction.commit()
        return failures[0]

    def tick(self) -> None:
        self.node.tick()
        self.commit()

    def take(self) -> list[bytes]:
        """Fetch everything, as the application."""
        taken = []
        while fetched := self.node.fetch():
            taken.append(fetched.payload)
            self.node.mark_delivered(fetched)
        self.commit()
        return taken

    def fates(self) -> list[DeliveryStatus]:
        return [notice.status for notice in self.notices]


Pair = tuple[TestedNode, TestedNode]


def nothing(_: list[bytes]) -> list[bytes]:
    """Lose everything."""
    return []


def carry(
    sender: TestedNode,
    receiver: TestedNode,
    *,
    bundle_octets: int = 1 << 20,
    change: Callable[[list[bytes]], list[bytes]] = lambda octets: octets,
) -> int:
    """Bring everything over a link that loses nothing; return how many octets that were."""
    carried, name = 0, str(receiver.settings.node)
    outgoing = partial(sender.node.sending.outgoing, name, 10_000, bundle_octets)
    while sent := outgoing(expedited=True) or outgoing():
        for octets in change([each.octets for each in sent]):
            carried += len(octets)
            receiver.node.receiving.receive(str(sender.settings.node), octets)
        assert receiver.commit() is None
        sender.node.sending.mark_forwarded(sent)
        sender.commit()
    return carried
