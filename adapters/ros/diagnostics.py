"""The executive's health as a DiagnosticArray, for rqt_robot_monitor and the like."""

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from adapters.ros.metronome import Beat
from executive.modes import Mode
from executive.runner import Executive


def diagnose(
    executive: Executive, beat: Beat, rejected: int, name: str, stamp: Time
) -> DiagnosticArray:
    """Return one status: ERROR when SAFE, WARN for late ticks, no odometry or bad messages.

    Args:
        executive: who is diagnosed.
        beat: the ticks since the last diagnosis.
        rejected: messages refused since the last diagnosis.
        name: the node's full name.
        stamp: when, on the node's clock.
    """
    status = executive.status
    late = beat.ticks == 0 or beat.longest_tick_s > executive.settings.tick_s
    if executive.mode is Mode.SAFE:
        level, text = DiagnosticStatus.ERROR, executive.why
    elif late:
        level, text = DiagnosticStatus.WARN, "the tick is late"
    elif not status.odometry_fresh:
        level, text = DiagnosticStatus.WARN, "no odometry"
    elif rejected:
        level, text = DiagnosticStatus.WARN, "messages were refused"
    else:
        level, text = DiagnosticStatus.OK, executive.why
    values = {
        "mode": executive.mode.name,
        "why": executive.why,
        "tick period [s]": "none" if beat.period_s is None else f"{beat.period_s:.4f}",
        "longest tick period [s]": f"{beat.longest_period_s:.4f}",
        "longest tick [s]": f"{beat.longest_tick_s:.4f}",
        "overruns": str(beat.overruns),
        "odometry age [s]": f"{status.odometry_age_s:.3f}",
        "goals": str(len(executive.context.motion) + len(executive.context.camera)),
        "ledger sequence": str(executive.ledger.last_sequence),
        "messages refused": str(rejected),
    }
    message = DiagnosticArray()
    message.header.stamp = stamp
    message.status = [
        DiagnosticStatus(
            level=level,
            name=f"{name}: executive",
            hardware_id=executive.settings.asset,
            message=text,
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )
    ]
    return message
