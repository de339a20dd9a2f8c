from pathlib import Path

from executive.commands import Command, Stop
from executive.record import Ledger, RelayedCommand, RelayRecord
from executive.reports import Identity, Stage


def test_what_came_by_the_relay_is_forgotten_with_its_command(tmp_path: Path) -> None:
    ledger = Ledger(tmp_path / "ledger.sqlite")
    record = RelayRecord(ledger)
    for number in (1, 2):
        command = Command(Identity("MOE", number), Stop(), "relay", counter=number)
        ledger.record(command)
        ledger.reach(command.identity, Stage.EXECUTED)
        record.remember(command, 0x10)
    ledger.commit()
    ledger.prune(Identity("MOE", 1), Stage.EXECUTED)
    ledger.commit()
    assert record.asked(Identity("MOE", 1)) is None
    assert record.asked(Identity("MOE", 2)) == RelayedCommand(0x10, 2)
    ledger.close()
