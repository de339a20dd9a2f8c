"""What a process needs that deploys an agent."""

from pathlib import Path

import pytest

from adapters.bundle.codec.eid import Ipn
from adapters.bundle.codec.errors import BundleError
from adapters.bundle.links.contact import PlanError, load_contact_plan
from adapters.bundle.node.settings import (
    Address,
    LtpLink,
    Neighbour,
    NodeSettings,
)

START_S = 1_763_730_000.0
PLAN = "a contact +60 +120 1 2 125000\n"
BACK = "a contact +60 +120 2 1 125000\n"
NODE = NodeSettings(
    Ipn(1, 1), (Ipn(1, 1),), (Neighbour(Ipn(2, 0), LtpLink(Address("127.0.0.1", 1114))),)
)


class Deployed:
    """Settings with a plan beside them, and a folder of data."""

    def __init__(self, folder: Path) -> None:
        self.settings = folder / "config" / "orbiter.yaml"
        self.data = folder / "data"
        self.settings.parent.mkdir()
        self.data.mkdir()

    def write(self, text: str) -> None:
        (self.settings.parent / "contacts.ionrc").write_text(text)

    def start(self, utc_s: float) -> list[tuple[float, float]]:
        """Return from when to when contacts are planned."""
        plan = load_contact_plan(self.settings, "contacts.ionrc", self.data, NODE, lambda: utc_s)
        assert plan is not None
        return [(contact.begin_utc_s, contact.end_utc_s) for contact in plan.contacts]


@pytest.fixture
def deployed(tmp_path: Path) -> Deployed:
    return Deployed(tmp_path)


def test_relative_times_count_from_the_first_start_with_a_plan(deployed: Deployed) -> None:
    deployed.write(PLAN)
    planned = [(START_S + 60, START_S + 120)]
    assert deployed.start(START_S) == planned
    assert deployed.start(START_S + 90.5) == planned
    deployed.write(PLAN + "a contact +200 +300 1 2 125000\n")
    assert deployed.start(START_S + 100) == [
        (START_S + 160, START_S + 220),
        (START_S + 300, START_S + 400),
    ]
    assert deployed.start(START_S + 500)[0] == (START_S + 160, START_S + 220)


def test_both_ends_may_share_a_folder(deployed: Deployed) -> None:
    deployed.write(PLAN)
    first = deployed.start(START_S)
    deployed.settings = deployed.settings.with_name("jackal.relay.yaml")
    deployed.write(PLAN + "\n")
    assert deployed.start(START_S + 10) != first
    deployed.settings = deployed.settings.with_name("orbiter.yaml")
    deployed.write(PLAN)
    assert deployed.start(START_S + 20) == first


def test_a_reference_in_the_plan_goes_before(deployed: Deployed) -> None:
    deployed.write(f"@ 2025/11/21-13:00:00\n{PLAN}")
    assert (
        deployed.start(START_S) == deployed.start(START_S + 9.0) == [(START_S + 60, START_S + 120)]
    )


def test_a_plan_that_makes_no_sense_is_not_the_first(deployed: Deployed) -> None:
    for text in (None, "a contact +60\n"):
        if text is not None:
            deployed.write(text)
        with pytest.raises(PlanError, match="contact plan"):
            deployed.start(START_S)
    deployed.write(PLAN)
    assert deployed.start(START_S + 10) == [(START_S + 70, START_S + 130)]


@pytest.mark.parametrize("broken", [b"", b"yesterday\n" + PLAN.encode(), b"\xff\n" + PLAN.encode()])
def test_what_cannot_be_read_begins_anew(deployed: Deployed, broken: bytes) -> None:
    deployed.write(PLAN)
    deployed.start(START_S)
    (kept,) = deployed.data.iterdir()
    kept.write_bytes(broken)
    assert deployed.start(START_S + 10) == [(START_S + 70, START_S + 130)]
    assert deployed.start(START_S + 20) == [(START_S + 70, START_S + 130)]


def test_a_full_disk_is_told_with_the_folder(deployed: Deployed) -> None:
    deployed.write(PLAN)
    (deployed.data / "orbiter.begun.new").symlink_to("/dev/full")
    with pytest.raises(BundleError, match=rf"{deployed.data} cannot be written: No space left"):
        deployed.start(START_S)


def test_without_a_plan_there_is_always_contact(deployed: Deployed) -> None:
    assert load_contact_plan(deployed.settings, None, deployed.data, NODE) is None


@pytest.mark.parametrize(
    ("plan", "closed"),
    [
        (PLAN + BACK, []),
        ("", [(1, 2), (2, 1)]),
        (PLAN, [(2, 1)]),
        (BACK, [(1, 2)]),
        ("a contact +60 +120 1 3 1\na contact +60 +120 3 1 1\n", [(1, 2), (2, 1)]),
        (f"@ 2025/11/20-12:00:00\n{PLAN}{BACK}", [(1, 2), (2, 1)]),
    ],
    ids=["both ways", "empty", "only up", "only down", "other nodes", "past"],
)
def test_a_way_that_a_plan_never_opens_is_warned_of(
    deployed: Deployed,
    caplog: pytest.LogCaptureFixture,
    plan: str,
    closed: list[tuple[int, int]],
) -> None:
    deployed.write(plan)
    deployed.start(START_S)
    told = [record.getMessage() for record in caplog.records if record.levelname == "WARNING"]
    assert len(told) == len(closed)
    for text, (sender, receiver) in zip(told, closed, strict=True):
        assert "contacts.ionrc: " in text
        assert f"from node {sender} to node {receiver} no contact" in text
