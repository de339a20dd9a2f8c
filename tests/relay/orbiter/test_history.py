"""What the orbiter forgets of a rover, and what it must not."""

from pathlib import Path

from adapters.bundle import BundleId
from adapters.bundle.codec.bundle import Creation
from adapters.bundle.codec.eid import Ipn
from adapters.relay.orbiter.record import RoverRecord
from executive.commands.catalogue import Command, MoveForward, Request, Stop
from executive.reports import Identity, Kind, Report, Severity, Stage

MOST = 10
LIFETIME_S = 100.0
LIFE = (Stage.RECEIVED, Stage.ACCEPTED, Stage.EXECUTED)
TABLES = ("commands", "stages", "asked", "reports", "heard")


class Kept:
    """A record with a short memory, and the commands that came and ended."""

    def __init__(self, path: Path, numbered: bool = True) -> None:
        self.path, self.numbered = path, numbered
        self.record = RoverRecord(path, numbered, MOST)
        self.last = 0

    def restart(self) -> None:
        self.record.close()
        self.record = RoverRecord(self.path, self.numbered, MOST)

    def run(
        self,
        number: int,
        request: Request = MoveForward(1.0),  # noqa: B008 - frozen
        life: tuple[Stage, ...] = LIFE,
        utc_s: float = 0.0,
    ) -> None:
        identity = Identity("MOE", number)
        bundle = BundleId(Ipn(1, 1), Creation(1000, number))
        command = Command(identity, request, "relay")
        self.record.outstanding.add(command, b"asked", bundle, utc_s, utc_s + LIFETIME_S)
        self.record.outstanding.left_outbox(bundle, utc_s)
        for stage in life:
            self.tell(stage, identity)

    def tell(self, stage: Stage, identity: Identity) -> Report | None:
        self.last += 1
        return self.record.add_report(self.report(self.last, stage, identity), f"unit {self.last}")

    def report(self, number: int, stage: Stage, identity: Identity) -> Report:
        sequence = number if self.numbered else 0
        informational = Severity.INFORMATIONAL
        return Report(sequence, 1.0, Kind.COMMAND, informational, "", identity, stage, "relay")

    def known(self, number: int) -> bool:
        return self.record.ledger.digest_of(Identity("MOE", number)) is not None

    def sizes(self) -> dict[str, int]:
        rows = {name: self.record.ledger.rows(f"SELECT count(*) FROM {name}") for name in TABLES}
        return {name: count for name, ((count,),) in rows.items()}


def test_the_oldest_is_forgotten_whole(tmp_path: Path) -> None:
    kept = Kept(tmp_path / "r")
    for number in range(1, 21):
        kept.run(number)
    kept.record.prune(LIFETIME_S + 1.0)
    assert [r.sequence for r in kept.record.ledger.reports()] == list(range(49, 61))
    assert kept.sizes() == {"commands": 4, "stages": 4, "asked": 4, "reports": 12, "heard": 0}
    assert not kept.known(16)
    assert kept.known(17)


def test_what_was_forgotten_is_not_told_again(tmp_path: Path) -> None:
    kept = Kept(tmp_path / "r")
    for number in range(1, 21):
        kept.run(number)
    kept.record.prune(LIFETIME_S + 1.0)
    kept.restart()
    again = kept.report(3, Stage.EXECUTED, Identity("MOE", 1))
    assert kept.record.add_report(again, "once more") is None
    kept.run(21)
    assert kept.record.ledger.reports()[-1].sequence == 63


def test_within_its_lifetime_every_command_is_known(tmp_path: Path) -> None:
    kept = Kept(tmp_path / "r")
    for number in range(1, 21):
        kept.run(number, utc_s=float(number))
    kept.record.prune(LIFETIME_S + 5.5)
    assert [kept.known(number) for number in range(1, 21)] == [False] * 5 + [True] * 15
    assert kept.sizes()["reports"] == 45


def test_what_is_under_way_stays_and_so_does_a_stop_that_holds(tmp_path: Path) -> None:
    kept = Kept(tmp_path / "r")
    kept.run(1, life=(Stage.RECEIVED, Stage.STARTED))
    kept.run(2, Stop())
    for number in range(3, 31):
        kept.run(number)
    kept.record.prune(LIFETIME_S + 1.0)
    assert kept.known(1)
    assert kept.record.outstanding.active() == 1
    assert kept.record.ledger.last_stop() == Identity("MOE", 2)
    assert not kept.known(3)
    kept.tell(Stage.EXECUTED, Identity("MOE", 1))
    assert kept.record.outstanding.active() is None


def test_events_and_replies_of_a_brick_are_forgotten_too(tmp_path: Path) -> None:
    kept = Kept(tmp_path / "r", numbered=False)
    kept.run(1, Stop())  # which holds nothing
    for number in range(2, 41):
        kept.run(number)
    kept.record.prune(LIFETIME_S + 1.0)
    sizes = kept.sizes()
    assert sizes["reports"] == sizes["heard"] == 12
    assert kept.record.ledger.reports()[-1].sequence == 120
    events = Kept(tmp_path / "e")
    for number in range(1, 41):
        event = Report(number, 1.0, Kind.EVENT, Severity.WARNING, "a stone")
        events.record.add_report(event, f"unit {number}")
    events.record.prune(0.0)
    assert events.sizes()["reports"] == MOST


def test_refusals_without_a_number_are_forgotten_too(tmp_path: Path) -> None:
    kept = Kept(tmp_path / "r")
    for number in range(1, 41):
        refusal = kept.report(0, Stage.REJECTED, Identity("MOE", number))
        assert kept.record.add_report(refusal, f"unit {number}") == refusal
    kept.record.prune(0.0)
    assert kept.sizes()["reports"] == kept.sizes()["heard"] == MOST
    assert kept.record.last_report(Identity("MOE", 40)) is not None
    assert kept.record.last_report(Identity("MOE", 30)) is None
