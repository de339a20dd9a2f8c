"""Links with a predicted pose, and the times of that."""

from math import nan
from types import SimpleNamespace
from typing import Any, cast

import pytest

from adapters.console.messages import LinkKind, PosePrediction
from adapters.console.rovers import pose_prediction
from adapters.console.rovers.pose_prediction import PosePredictor
from adapters.console.rovers.rover_link import RoverLink
from adapters.mrs.ground import LinkDelay
from adapters.mrs.spec import ReceivedValue
from adapters.twin import Twin
from executive.commands import DIRECT_LINK, Command, MoveForward
from executive.settings import load_settings
from executive.values.reports import Identity

NOW_S = 1_800_000_000.0
LEAD_S = 86_400.0
JACKAL = load_settings("jackal")


def link(declared_s: float = 10.0, kind: LinkKind = LinkKind.DIRECT, **figures: float) -> RoverLink:
    given = SimpleNamespace(asset="jackal", kind=kind, delay=LinkDelay(declared_s), figures=figures)
    return cast(RoverLink, given)


LED = link(LINK_CLOCK_OFFSET=LEAD_S)


def report(predictor: PosePredictor, utc_s: float, x_m: float = 1.0, **more: float) -> None:
    for name, value in {"POS_X": x_m, "POS_Y": 2.0, "HEAD": 0.0, **more}.items():
        predictor.on_value(ReceivedValue(name, utc_s, value))


async def predicted(settings: Any, on: RoverLink, lead_s: float = 0.0) -> PosePrediction | None:
    predictor = PosePredictor(settings)
    try:
        assert await predictor.predict(on, NOW_S) is None, "nothing was reported"
        report(predictor, NOW_S - 5.0 + lead_s)
        return await predictor.predict(on, NOW_S)
    finally:
        predictor.close()


async def test_stamps_of_a_clock_that_leads_are_converted() -> None:
    found = await predicted(JACKAL, LED, LEAD_S)
    assert found is not None
    assert found.as_of == NOW_S - 5.0
    assert found.arrival == pytest.approx(NOW_S + 5.0)
    assert (found.x, found.y) == (1.0, 2.0)


async def test_nothing_is_predicted_without_delay_settings_or_clock() -> None:
    assert await predicted(JACKAL, link(0.5, LINK_CLOCK_OFFSET=0.0)) is None
    assert await predicted(None, link(LINK_CLOCK_OFFSET=0.0)) is None
    assert await predicted(JACKAL, link()) is None


async def test_an_error_of_the_twin_ends_the_prediction_only(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    predictor = PosePredictor(JACKAL)
    report(predictor, NOW_S - 6.0)
    await predictor.predict(LED, NOW_S)

    def fail(*_: object) -> None:
        raise RuntimeError("any defect of the twin")

    monkeypatch.setattr(Twin, "on_sent", fail)
    predictor.on_sent(Command(Identity("anna", 1), MoveForward(3.0), DIRECT_LINK), NOW_S)
    report(predictor, NOW_S - 5.0 + LEAD_S)
    assert await predictor.predict(LED, NOW_S) is None


async def test_a_twin_that_cannot_start_is_not_tried_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fail(*_: object) -> None:
        raise OSError("no space left")

    monkeypatch.setattr(pose_prediction, "Twin", fail)
    predictor = PosePredictor(JACKAL)
    assert await predictor.predict(LED, NOW_S) is None
    assert await predictor.predict(LED, NOW_S) is None


async def test_a_pose_that_is_no_number_is_ignored() -> None:
    predictor = PosePredictor(JACKAL)
    await predictor.predict(LED, NOW_S)
    report(predictor, NOW_S - 6.0 + LEAD_S)
    report(predictor, NOW_S - 5.0 + LEAD_S, x_m=nan)
    found = await predictor.predict(LED, NOW_S)
    predictor.close()
    assert found is not None
    assert (found.as_of, found.x) == (NOW_S - 6.0, 1.0)


async def test_a_relay_link_has_the_light_time_behind_the_orbiter() -> None:
    predictor = PosePredictor(JACKAL)
    relay = link(0.0, LinkKind.RELAY)
    predictor.on_value(ReceivedValue("DTN_ROUND_TRIP", NOW_S, 8.0))
    await predictor.predict(relay, NOW_S)
    report(predictor, NOW_S - 4.0)
    found = await predictor.predict(relay, NOW_S)
    predictor.close()
    assert found is not None
    assert found.link is LinkKind.RELAY
    assert found.arrival == pytest.approx(NOW_S + 4.0)


async def test_after_the_clock_aboard_is_set_the_twin_starts_again() -> None:
    predictor = PosePredictor(JACKAL)
    await predictor.predict(LED, NOW_S)
    report(predictor, NOW_S - 5.0 + LEAD_S)
    moved = Command(Identity("anna", 1), MoveForward(3.0), DIRECT_LINK)
    predictor.on_sent(moved, NOW_S - 2.0)
    before = await predictor.predict(LED, NOW_S)
    assert before is not None
    assert before.x > 2.0
    exact = link(LINK_CLOCK_OFFSET=0.0)
    assert await predictor.predict(exact, NOW_S) is None
    report(predictor, NOW_S - 4.0)
    after = await predictor.predict(exact, NOW_S)
    predictor.close()
    assert after is not None
    assert (after.as_of, after.x) == (NOW_S - 4.0, 1.0)
