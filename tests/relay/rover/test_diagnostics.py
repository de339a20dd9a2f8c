"""What /diagnostics says of the rover's end of the relay."""

from dataclasses import replace

import pytest
from diagnostic_msgs.msg import DiagnosticStatus

from adapters.bundle import Health
from adapters.mops import LinkHealth
from adapters.relay.rover.node import diagnose

LINK = LinkHealth(1.8e9, 2, 4.0, None, 0.5, 0, 0)
AGENT = Health(2, 4.0, 0, 7, 0, 1000, full_text="", neighbours=())
FULL = replace(AGENT, full_text="bundle store x: there is no room")


@pytest.mark.parametrize(
    ("agent", "received", "level", "text"),
    [
        (None, True, DiagnosticStatus.ERROR, "the bundle agent is not running"),
        (AGENT, True, DiagnosticStatus.OK, "2 bundles wait to be sent"),
        (AGENT, False, DiagnosticStatus.WARN, "no subscriber to commands"),
        (FULL, False, DiagnosticStatus.WARN, "bundle store x: there is no room"),
    ],
)
def test_the_worst_is_reported(
    agent: Health | None, received: bool, level: bytes, text: str
) -> None:
    health = None if agent is None else LINK
    *message, values = diagnose(health, agent, 0, received)
    assert message == [level, text]
    expected = {} if agent is None else {"queued": 2, "expired": 7, "free_octets": 1000}
    assert expected.items() <= values.items()
