"""By which convergence layer bundles go between orbiter and rover."""

from enum import Enum
from typing import Final, TypedDict, assert_never

from adapters.bundle import Address, Listen, LtpLink
from adapters.bundle.node.settings import TcpclLink, UdpLink

_PORTS: Final = {"ltp": 1113, "tcpcl": 4556, "udp": 4557}
_ANY: Final = "0.0.0.0"


class Convergence(Enum):
    """A convergence layer; over TCPCL the rover dials, over UDPCL receivers confirm."""

    LTP = "ltp"
    TCPCL = "tcpcl"
    UDP = "udp"


class Links(TypedDict, total=False):
    """The link of a `Peer`, by its key there."""

    ltp: LtpLink
    tcpcl: TcpclLink
    udp: UdpLink


def listen(layer: Convergence) -> Listen:
    """Return where an agent listens."""
    address = Address(_ANY, _PORTS[layer.value])
    match layer:
        case Convergence.LTP:
            return Listen(ltp=address)
        case Convergence.TCPCL:
            return Listen(tcpcl=address)
        case Convergence.UDP:
            return Listen(udp=address)
        case _:
            assert_never(layer)


def link_to(layer: Convergence, host: str, answer_s: float, *, dials: bool) -> Links:
    """Return how an agent reaches another.

    Args:
        layer: by which convergence layer.
        host: the other's computer.
        answer_s: how long it may take to answer, there and back.
        dials: whether it is this end that connects, over TCPCL.
    """
    address = Address(host, _PORTS[layer.value])
    match layer:
        case Convergence.LTP:
            return {"ltp": LtpLink(address, answer_s=answer_s)}
        case Convergence.TCPCL:
            return {"tcpcl": TcpclLink(address if dials else None)}
        case Convergence.UDP:
            return {"udp": UdpLink(address)}
        case _:
            assert_never(layer)
