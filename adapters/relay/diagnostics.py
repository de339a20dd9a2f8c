"""The relay's health as a DiagnosticArray."""

from dataclasses import asdict

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from adapters.bundle import Health
from adapters.mops.link_health import LinkHealth


def diagnose(
    health: LinkHealth | None,
    agent: Health | None,
    refused: int,
    heard: bool,
    asset: str,
    name: str,
    stamp: Time,
) -> DiagnosticArray:
    """Return one status: ERROR without an agent, WARN where it is full or nobody takes commands.

    Args:
        health: how the link is, as the ground is told; None before the first look.
        agent: how the agent itself is.
        refused: messages refused since the last diagnosis.
        heard: whether somebody takes commands.
        asset: the rover's name.
        name: the node's full name.
        stamp: when, on the node's clock.
    """
    if health is None or agent is None:
        level, text = DiagnosticStatus.ERROR, "the bundle agent is not there"
    elif agent.full:
        level, text = DiagnosticStatus.WARN, agent.no_room
    elif not heard:
        level, text = DiagnosticStatus.WARN, "nobody takes commands"
    elif refused:
        level, text = DiagnosticStatus.WARN, "messages were refused"
    else:
        level, text = DiagnosticStatus.OK, f"{health.queued} bundles wait to be sent"
    values = {} if health is None else asdict(health)
    if agent is not None:
        values |= {"expired": agent.expired, "room_octets": agent.room_octets}
    message = DiagnosticArray()
    message.header.stamp = stamp
    message.status = [
        DiagnosticStatus(
            level=level,
            name=f"{name}: relay",
            hardware_id=asset,
            message=text,
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )
    ]
    return message
