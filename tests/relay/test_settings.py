"""The settings of the rover's end of the relay."""

from pathlib import Path

import pytest

from adapters.relay.settings import load_relay
from executive.settings import SettingsError


@pytest.mark.parametrize("asset", ["jackal", "mocup"])
def test_the_settings_of_our_assets_fit(asset: str) -> None:
    settings, path = load_relay(asset)
    assert (settings.asset, path.name) == (asset.upper(), f"{asset}.relay.yaml")
    assert settings.node().neighbour_of(settings.ground) == "ipn:1.0"


@pytest.mark.parametrize(
    ("changed", "fault"),
    [
        (("eid: ipn:2.1", "eid: two"), "no endpoint such as"),
        (("eid: ipn:2.1", "eid: ipn:1.2"), "eid ipn:1.2 and orbiter.eid ipn:1.1 are on one node"),
        (("asset: JACKAL", "asset: SCOUT"), "asset is SCOUT, and the name of jackal in messages"),
        (("  ltp: {address", "  sms: {address"), "sms"),
        (("  ltp: {address: {host: 127.0.0.1, port: 1113}}\n", ""), "one of ltp, tcpcl, udp"),
        (("telemetry_queue: 4", "telemetry_queu: 4"), "telemetry_queu"),
        (("port: 1114", "port: 99999"), "99999 is not a port"),
        (("lifetime_s: 604800.0", "lifetime_s: 0"), "lifetime_s must be above 0"),
    ],
)
def test_settings_that_do_not_fit_are_refused(
    tmp_path: Path, changed: tuple[str, str], fault: str
) -> None:
    _, path = load_relay("jackal")
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text(path.read_text().replace(*changed))
    with pytest.raises(SettingsError, match=fault):
        load_relay("jackal", wrong)
    with pytest.raises(SettingsError, match="nobody has no relay; there is one for jackal, mocup"):
        load_relay("nobody")
