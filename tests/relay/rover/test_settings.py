"""The settings of the rover's end of the relay."""

from pathlib import Path

import pytest

from adapters.relay.orbiter import OrbiterSettings, RelayedRoverSettings, load_orbiter
from adapters.relay.rover import RelaySettings, load_relay
from executive.settings import SettingsError, config_folder
from tests.docs.pages import CHECKOUT, blocks


@pytest.mark.parametrize("asset", ["jackal", "mocup"])
def test_the_settings_of_our_assets_fit(asset: str) -> None:
    settings, path = load_relay(asset)
    assert (settings.asset, path.name) == (asset.upper(), f"{asset}.relay.yaml")
    assert settings.node().neighbour_of(settings.ground) == "ipn:1.0"


@pytest.mark.parametrize(
    ("changed", "fault"),
    [
        (("eid: ipn:2.1", "eid: two"), r"wrong\.yaml: eid: not an endpoint such as .*: 'two'$"),
        (("eid: ipn:1.1", "eid: 1"), r"orbiter\.eid: expected a text, got 1$"),
        (("eid: ipn:1.1", "eid: one"), r"orbiter: eid: not an endpoint such as .*: 'one'$"),
        (("eid: ipn:1.1", "eid: dtn:none"), "orbiter: eid: dtn:none is the null endpoint$"),
        (("eid: ipn:2.1", "eid: ipn:1.2"), "eid ipn:1.2 and orbiter.eid ipn:1.1 are on one node"),
        (
            ("asset: JACKAL", "asset: SCOUT"),
            "asset is SCOUT, but jackal is named JACKAL in messages",
        ),
        (("  ltp: {address", "  sms: {address"), "sms"),
        (("  ltp: {address: {host: 127.0.0.1, port: 1113}}\n", ""), "one of ltp, tcpcl, udp"),
        (("telemetry_queue: 4", "telemetry_queu: 4"), "telemetry_queu"),
        (("port: 1114", "port: 99999"), "port 99999 is not in 0 to 65535"),
        (("lifetime_s: 604800.0", "lifetime_s: 0"), "lifetime_s must be above 0"),
        (("lifetime_s: 604800.0", "lifetime_s: .inf"), "lifetime_s: expected a finite number"),
        (("lifetime_s: 30.0", "lifetime_s: 1.0e+300"), "telemetry_lifetime_s must be .* at most"),
        (("lifetime_s: 30.0", "lifetime_s: .nan"), "telemetry_lifetime_s: expected a finite"),
        (("telemetry_queue: 4", "telemetry_queue: -1"), "telemetry_queue is -1, must be 0 or more"),
        (("asset: JACKAL", "asset: ''"), "asset is '': a name has"),
        (("asset: JACKAL", "asset: JACKAL|2"), r"asset is 'JACKAL\|2': a name has"),
        (("asset: JACKAL", "asset: ../JACKAL"), "asset is '../JACKAL': it names files"),
        (("listen:\n  ltp", "listen:\n  udp"), "listen lacks ltp, which the link to orbiter needs"),
        (
            ("  ltp: {address", "  udp: {address"),
            "listen lacks udp, which the link to orbiter needs",
        ),
        (("port: 1113", "port: 0"), "ltp.address of orbiter has port 0"),
        (("  ltp: {host: 127.0.0.1, port: 1114}", "  {}"), "listen lacks ltp, which the link"),
        (
            ("ltp: {address: {host: 127.0.0.1, port: 1113}}", "tcpcl: {address: null}"),
            "tcpcl.address of orbiter is null, and section listen has no tcpcl",
        ),
        (("health_interval_s", "agent: ion\nhealth_interval_s"), "remove ltp of orbiter"),
        (
            ("  ltp: {address: {host: 127.0.0.1, port: 1113}}\n", "agent: ion\n"),
            "agent is ion, a daemon that listens itself: remove section listen",
        ),
    ],
)
def test_settings_that_do_not_fit_are_refused(
    tmp_path: Path, changed: tuple[str, str], fault: str
) -> None:
    _, path = load_relay("jackal")
    wrong = tmp_path / "wrong.yaml"
    text = path.read_text()
    assert changed[0] in text
    wrong.write_text(text.replace(*changed))
    with pytest.raises(SettingsError, match=fault) as caught:
        load_relay("jackal", wrong)
    assert str(wrong) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_asset_without_a_relay_receives_a_hint_to_those_with_one() -> None:
    with pytest.raises(SettingsError, match="nobody has no relay; files exist for jackal, mocup"):
        load_relay("nobody")


OTHER_LINKS = pytest.mark.parametrize("link", ["tcpcl", "udp"])


def uncommented(path: Path, link: str) -> str:
    """Return a file of ours with what its comments offer in place of LTP."""
    stored = [line for line in path.read_text().splitlines() if not line.strip().startswith("ltp:")]
    return "\n".join(line.replace(f"# {link}: {{", f"{link}: {{") for line in stored)


@OTHER_LINKS
def test_the_comments_of_our_files_offer_other_links_that_meet(tmp_path: Path, link: str) -> None:
    above = tmp_path / "orbiter.yaml"
    above.write_text(uncommented(config_folder() / "mops" / "orbiter.yaml", link))
    orbiter = load_orbiter(above)
    for rover in orbiter.rovers:
        _, path = load_relay(rover.asset)
        aboard = tmp_path / path.name
        text = uncommented(path, link)
        aboard.write_text(text.replace("listen:\n", "") if link == "tcpcl" else text)
        relay, _ = load_relay(rover.asset, aboard)
        require_meeting(orbiter, rover, relay, link)


@OTHER_LINKS
def test_the_links_of_the_page_meet(tmp_path: Path, link: str) -> None:
    files = {}
    for block in blocks(CHECKOUT / "docs" / "relay.md", "yaml"):
        if f"{link}:" in block:
            name = block.splitlines()[0].removeprefix("# config/")
            files[name] = tmp_path / Path(name).name
            files[name].write_text(block)
    orbiter = load_orbiter(files["mops/orbiter.yaml"])
    relay, _ = load_relay("jackal", files["jackal.relay.yaml"])
    require_meeting(orbiter, orbiter.rovers[0], relay, link)


def require_meeting(
    orbiter: OrbiterSettings, rover: RelayedRoverSettings, relay: RelaySettings, link: str
) -> None:
    assert (rover.eid, orbiter.eid) == (relay.eid, relay.orbiter.eid)
    ((down_key, down),) = rover.links.items()
    ((up_key, up),) = relay.orbiter.links.items()
    assert down_key == up_key == link
    assert up.address is not None
    assert up.address.port == getattr(orbiter.listen, link).port
    listens = getattr(relay.listen, link)
    assert (down.address and down.address.port) == (listens and listens.port)
