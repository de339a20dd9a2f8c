"""The end of a lifetime is told by whoever has the bundle, and comes before all else."""

from math import inf
from pathlib import Path

from adapters.bundle.codec.eid import Ipn
from adapters.bundle.node.reporting import DeliveryStatus
from tests.bundle.nodes import Clock, TestedNode, carry, settings_of


def test_what_is_over_is_told_and_not_sent_though_the_link_comes_first(tmp_path: Path) -> None:
    clock = Clock()
    one = TestedNode(tmp_path, settings_of(1, 2), clock)
    two = TestedNode(tmp_path, settings_of(2, 1), clock)
    one.put(Ipn(2, 1), b"short", lifetime_s=10.0)
    one.put(Ipn(2, 1), b"long")
    clock.utc_ms += 10_000
    carry(one, two)
    assert two.take() == [b"long"]
    one.tick()
    assert one.fates() == [DeliveryStatus.HANDED_ON, DeliveryStatus.EXPIRED]


def test_what_is_to_live_for_ever_lives_as_long_as_can_be_said(tmp_path: Path) -> None:
    clock = Clock()
    one = TestedNode(tmp_path, settings_of(1, 2), clock)
    two = TestedNode(tmp_path, settings_of(2, 1), clock)
    one.put(Ipn(2, 1), b"x", lifetime_s=inf)
    carry(one, two)
    assert two.take() == [b"x"]
