"""Figures that make no sense are refused where they are said, by their names."""

from collections.abc import Callable
from functools import partial
from math import inf, nan

import pytest

from adapters.bundle.codec.eid import Ipn
from adapters.bundle.node.settings import (
    Address,
    DaemonLink,
    IonSettings,
    LtpLink,
    NodeSettings,
    TcpclLink,
    UdpLink,
)

TO = Address("127.0.0.1", 1113)
OWN = Ipn(1, 1)


@pytest.mark.parametrize(
    ("made", "name", "least", "maximum"),
    [
        (partial(LtpLink, TO), "segment_octets", 10, 65_000),
        (partial(TcpclLink, TO), "keepalive_s", 0, 65_535),
        (partial(UdpLink, TO), "bundle_octets", 512, 65_507),
        (partial(DaemonLink, OWN), "confirm_after_s", 0.1, 1e7),
        (partial(NodeSettings, OWN, (OWN,), ()), "hop_limit", 1, 255),
        (IonSettings, "answer_s", 0.1, 86_400.0),
    ],
)
def test_a_figure_is_within_its_bounds(
    made: Callable[..., object], name: str, least: float, maximum: float
) -> None:
    for fitting in (least, maximum):
        made(**{name: fitting})
    for wrong in (least - 1, maximum + 1, -1e300, inf, nan):
        with pytest.raises(ValueError, match=f"^{name} must be "):
            made(**{name: wrong})


@pytest.mark.parametrize("host", ["orbiter..example", "o" * 64 + ".example", ".", "orbiter\0"])
def test_a_host_that_no_name_service_takes_is_refused(host: str) -> None:
    with pytest.raises(ValueError, match=r"^host .* is not a host name: "):
        Address(host, 1113)


@pytest.mark.parametrize("host", ["", "::1", "fe80::1%eth0", "orbiter.example.", "bücher.example"])
def test_a_host_is_a_name_or_in_numbers(host: str) -> None:
    assert Address(host, 1113).host == host
