"""The relay's health as a DiagnosticArray."""

from dataclasses import asdict

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from adapters.mops.link_health import LinkHealth


def diagnose(
    health: LinkHealth | None, refused: int, heard: bool, asset: str, name: str, stamp: Time
) -> DiagnosticArray:
    """Return one status: ERROR without an agent, WARN where nobody takes commands.

    Args:
        health: how the agent is; None before the first look.
        refused: messages refused since the last diagnosis.
        heard: whether somebody takes commands.
        asset: the rover's name.
        name: the node's full name.
        stamp: when, on the node's clock.
    """
    if health is None:
        level, text = DiagnosticStatus.ERROR, "the bundle agent is not there"
    elif not heard:
        level, text = DiagnosticStatus.WARN, "nobody takes commands"
    elif refused:
        level, text = DiagnosticStatus.WARN, "messages were refused"
    else:
        level, text = DiagnosticStatus.OK, f"{health.queued} bundles wait to be sent"
    values = {} if health is None else asdict(health)
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
