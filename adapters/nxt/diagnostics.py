"""The brick's health as a DiagnosticArray."""

from dataclasses import asdict, dataclass

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from adapters.nxt.exits import Counts


@dataclass(frozen=True, slots=True)
class Health:
    """How the brick is.

    Attributes:
        brick: its name.
        address: where it is on USB.
        connected: whether it is there.
        why: what took it away.
        refused: messages refused since the last diagnosis.
    """

    brick: str
    address: str
    connected: bool
    why: str
    refused: int


def diagnose(health: Health, counts: Counts, name: str, stamp: Time) -> DiagnosticArray:
    """Return one status: ERROR without the brick, WARN where messages were refused.

    Args:
        health: how the brick is.
        counts: what passed since the start.
        name: the node's full name.
        stamp: when, on the node's clock.
    """
    if not health.connected:
        level, text = DiagnosticStatus.ERROR, f"the brick is not there: {health.why}"
    elif health.refused:
        level, text = DiagnosticStatus.WARN, "messages were refused"
    else:
        level, text = DiagnosticStatus.OK, "the brick is there"
    values = {"USB": health.address, **asdict(counts)}
    message = DiagnosticArray()
    message.header.stamp = stamp
    message.status = [
        DiagnosticStatus(
            level=level,
            name=f"{name}: brick",
            hardware_id=health.brick,
            message=text,
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )
    ]
    return message
