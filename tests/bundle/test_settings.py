"""Figures that make no sense are refused where they are said, by their names."""

from collections.abc import Callable, Mapping
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


def ltp(**figures: object) -> object:
    return LtpLink(TO, **figures)  # type: ignore[arg-type]


def tcpcl(**figures: object) -> object:
    return TcpclLink(TO, **figures)  # type: ignore[arg-type]


def udp(**figures: object) -> object:
    return UdpLink(TO, **figures)  # type: ignore[arg-type]


def daemon(**figures: object) -> object:
    return DaemonLink(OWN, **figures)  # type: ignore[arg-type]


def node(**figures: object) -> object:
    return NodeSettings(OWN, (OWN,), (), **figures)  # type: ignore[arg-type]


def ion(**figures: object) -> object:
    return IonSettings(**figures)  # type: ignore[arg-type]


FITTING: Mapping[Callable[..., object], Mapping[str, tuple[float, float]]] = {
    ltp: {
        "segment_octets": (10, 65_000),
        "block_octets": (1, 16 << 20),
        "bundle_octets": (512, 16 << 20),
        "sessions": (1, 256),
        "answer_s": (0.01, 86_400.0),
        "confirm_after_s": (0.1, 1e7),
    },
    tcpcl: {
        "keepalive_s": (0, 65_535),
        "segment_octets": (1, 64 << 20),
        "window_octets": (1, 1 << 30),
        "redial_s": (0.01, 3600.0),
        "confirm_after_s": (0.1, 1e7),
    },
    udp: {
        "bundle_octets": (512, 65_507),
        "rate_octets_s": (1, 1 << 40),
        "confirm_after_s": (0.1, 1e7),
    },
    daemon: {"confirm_after_s": (0.1, 1e7)},
    node: {"lifetime_s": (0.001, 1e10), "hop_limit": (1, 255), "most_payload_octets": (1, 1 << 30)},
    ion: {"answer_s": (0.1, 86_400.0), "look_s": (0.05, 86_400.0)},
}


@pytest.mark.parametrize(
    ("made", "name", "bounds"),
    [(made, name, bounds) for made, names in FITTING.items() for name, bounds in names.items()],
)
def test_a_figure_is_within_its_bounds(
    made: Callable[..., object], name: str, bounds: tuple[float, float]
) -> None:
    for fitting in bounds:
        made(**{name: fitting})
    least, most = bounds
    for wrong in (least - 1, most + 1, -1e300, inf, nan):
        with pytest.raises(ValueError, match=f"^{name} must be "):
            made(**{name: wrong})


@pytest.mark.parametrize("host", ["orbiter..example", "o" * 64 + ".example", ".", "orbiter\0"])
def test_a_host_that_no_name_service_takes_is_refused(host: str) -> None:
    with pytest.raises(ValueError, match=r"^host .* is no name of a host: "):
        Address(host, 1113)


@pytest.mark.parametrize("host", ["", "::1", "fe80::1%eth0", "orbiter.example.", "bücher.example"])
def test_a_host_is_a_name_or_in_numbers(host: str) -> None:
    assert Address(host, 1113).host == host
