"""Contact plans: their syntax, what they say, and the files of a deployment."""

from math import inf
from pathlib import Path

import pytest

from adapters.bundle.codec.eid import Dtn, Eid, Ipn
from adapters.bundle.codec.errors import BundleError
from adapters.bundle.links.contact import (
    ContactGate,
    ContactOverride,
    ContactPlan,
    ContactPlanError,
    load_contact_plan,
    parse_plan,
    read_plan,
)
from adapters.bundle.node.settings import Address, LtpLink, Neighbour, NodeSettings
from tests.bundle.test_faults import check_complete, complete, feed
from tests.bundle.weather import START_UTC_S, Weather, World
from tests.support.timed_system import TimedSystem

IONRC = """
## begin ionadmin
1 2 ''
s
# the orbiter passes twice
a contact +0 +600 1 2 125000
a contact +0 +600 2 1 9600 0.9     # both ways
a contact 2026/11/21-12:00:00 2026/11/21-12:10:00 1 2 125000
a range +0 +3600 1 2 3
m production 1000000
@ 2026/11/21-13:00:00
a contact +60 +120 1 2 0
"""
NOON_UTC_S = 1_795_262_400.0


@pytest.fixture
def plan() -> ContactPlan:
    return parse_plan(IONRC, 1000.0)


def test_a_plan_lists_the_times_of_contact(plan: ContactPlan) -> None:
    contact = plan.contact(1, 2, 1000.0)
    assert contact
    assert (contact.end_utc_s, contact.rate_octets_s) == (1600.0, 125_000)
    assert plan.contact(1, 2, 999.9) is None
    assert plan.contact(1, 2, 1600.0) is None
    assert plan.contact(2, 1, 1000.0)
    assert plan.contact(2, 3, 1000.0) is None
    assert plan.contact(1, 2, NOON_UTC_S)
    assert plan.contact(1, 2, NOON_UTC_S + 3660.0)


def test_a_plan_gives_the_next_contact(plan: ContactPlan) -> None:
    assert plan.next_contact_utc_s(1, 2, 0.0) == 1000.0
    assert plan.next_contact_utc_s(1, 2, 1000.0) == NOON_UTC_S
    assert plan.next_contact_utc_s(2, 1, 1000.0) == inf


def test_a_range_holds_in_both_directions(plan: ContactPlan) -> None:
    assert plan.light_time_s(1, 2, 1000.0) == plan.light_time_s(2, 1, 1000.0) == 3.0
    assert plan.light_time_s(1, 2, 5000.0) == 0.0


@pytest.mark.parametrize(
    ("line", "fault"),
    [
        ("a contact +0 +600 1 2", "RATE missing in `a contact BEGIN END SENDER RECEIVER RATE`"),
        ("a range +0 +600", "ONE OTHER LIGHT_TIME missing in `a range BEGIN END ONE OTHER"),
        ("a contact +0 +600 1 2 1 1 1", "too many fields for `a contact BEGIN END"),
        ("@ 2026-11-21 12:00", "@ takes one time such as .*: '2026-11-21 12:00'"),
        ("@ noon", "not a time such as .*: 'noon'"),
        ("a contact 2026/13/21-12:00:00 +600 1 2 1", "not a time such as"),
        ("a contact +600 +0 1 2 1", r"\+0 is not after \+600"),
        ("a contact +0 +600 1 x 1", "not a whole number: 'x'"),
        ("a range +0 +600 1 2 -3", "not a whole number: '-3'"),
        ("a contact +0 +9999999999999999999 1 2 1", "not a whole number"),
        ("a plan 2 udp", "neither `a contact"),
    ],
)
def test_an_invalid_line_is_reported_with_its_error(tmp_path: Path, line: str, fault: str) -> None:
    path = tmp_path / "plan.ionrc"
    path.write_text("# plan\n" + line + "\n")
    with pytest.raises(ContactPlanError, match=f"line 2: {fault}") as error:
        read_plan(path, 0.0)
    assert len(str(error.value).splitlines()) == 1


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(ContactPlanError, match="missing"):
        read_plan(tmp_path / "missing", 0.0)
    (tmp_path / "binary").write_bytes(b"\xff\xfe")
    with pytest.raises(ContactPlanError, match="UTF-8"):
        read_plan(tmp_path / "binary", 0.0)


@pytest.mark.parametrize("neighbour", [Ipn(2, 0), Dtn("//orbiter/")])
def test_the_operators_override_precedes_the_plan(neighbour: Eid) -> None:
    gate = ContactGate(Ipn(1, 0), neighbour, ContactPlan(), lambda: 0.0)
    assert gate.state().contact == isinstance(neighbour, Dtn)
    gate.override = ContactOverride.UP
    assert gate.state().contact
    gate.override = ContactOverride.DOWN
    assert not gate.state().contact


def test_nothing_is_sent_between_contacts_and_all_of_it_in_them(tmp_path: Path) -> None:
    lines = (
        f"a contact +{begin} +{begin + 20} {one} {other} 100000"
        for begin in (10, 100)
        for one, other in ((1, 2), (2, 1))
    )
    plan = parse_plan("\n".join([*lines, "a range +0 +1000 1 2 2"]), START_UTC_S)
    weather = Weather(0.1, least_delay_s=2.0, max_delay_s=2.0)
    world = World(tmp_path, 11, weather, LtpLink(Address("nowhere", 0)), plan=plan)
    to_two = feed(world, world.one, 200, until_s=5.0)
    late = [b"late %d" % number for number in range(50)]
    for payload in late:
        world.at(40.0, lambda payload=payload: world.one.put(payload))  # type: ignore[misc]
    world.run(9.9)
    assert world.datagrams == 0
    world.run(35.0)
    assert complete(world.two, to_two)
    sent = world.datagrams
    world.run(99.9)
    assert world.datagrams == sent
    assert world.run(120.0, lambda: complete(world.two, to_two + late))
    check_complete(world, [], to_two + late)


def test_a_slow_contact_is_not_flooded(tmp_path: Path) -> None:
    plan = parse_plan("a contact +0 +1000 1 2 1000\na contact +0 +1000 2 1 1000", START_UTC_S)
    world = World(tmp_path, 12, Weather(), LtpLink(Address("nowhere", 0)), plan=plan)
    to_two = feed(world, world.one, 300, until_s=0.1, octets=1000)
    world.run(100.0)
    arrived = sum(map(len, world.two.application.had.values()))
    assert 60_000 < arrived < 160_000
    assert world.run(400.0, lambda: complete(world.two, to_two))


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
        system = TimedSystem(lambda: utc_s)
        plan = load_contact_plan(self.settings, "contacts.ionrc", self.data, NODE, system)
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
        with pytest.raises(ContactPlanError, match="contact plan"):
            deployed.start(START_S)
    deployed.write(PLAN)
    assert deployed.start(START_S + 10) == [(START_S + 70, START_S + 130)]


@pytest.mark.parametrize("broken", [b"", b"yesterday\n" + PLAN.encode(), b"\xff\n" + PLAN.encode()])
def test_an_unreadable_override_starts_empty(deployed: Deployed, broken: bytes) -> None:
    deployed.write(PLAN)
    deployed.start(START_S)
    (stored,) = deployed.data.iterdir()
    stored.write_bytes(broken)
    assert deployed.start(START_S + 10) == [(START_S + 70, START_S + 130)]
    assert deployed.start(START_S + 20) == [(START_S + 70, START_S + 130)]


def test_a_full_disk_is_reported_with_the_folder(deployed: Deployed) -> None:
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
def test_a_path_that_a_plan_never_opens_causes_a_warning(
    deployed: Deployed, caplog: pytest.LogCaptureFixture, plan: str, closed: list[tuple[int, int]]
) -> None:
    deployed.write(plan)
    deployed.start(START_S)
    reported = [record.getMessage() for record in caplog.records if record.levelname == "WARNING"]
    assert len(reported) == len(closed)
    for text, (sender, receiver) in zip(reported, closed, strict=True):
        assert "contacts.ionrc: " in text
        assert f"no further contact is planned from node {sender} to node {receiver};" in text
