"""What a client knows of the rover's reports and of its own commands, out of its journal."""

from executive.commands import Command, Identity
from executive.reports import Report
from sim.kills.journal import Answer, Answered, Entry, Fetched, Fetching, Heard, Journal, Sent, Way


class View:
    """Writes down what is news, and knows what there is to do yet.

    Attributes:
        newest: the highest sequence number heard of.
        whole_to: the highest up to which none is missing.
    """

    def __init__(self, journal: Journal) -> None:
        """Know what the journal knows."""
        self._journal = journal
        self._commands: dict[Identity, Command] = {}
        self._answered: dict[Identity, Answer] = {}
        self._ended: set[Identity] = set()
        self._reports: dict[int, Report] = {}
        self._fetching: Fetching | None = None
        self._fetches = 0
        self.newest = self.whole_to = 0
        for entry in journal.entries:
            self._learn(entry)

    @property
    def next_number(self) -> int:
        """A command number that was not used yet."""
        return 1 + max((each.command_id for each in self._commands), default=0)

    @property
    def commands(self) -> list[Command]:
        """All that were sent, in the order of the first time."""
        return list(self._commands.values())

    @property
    def unanswered(self) -> list[Command]:
        """What was sent and not acknowledged, in the order sent."""
        return [self._commands[each] for each in self._commands if each not in self._answered]

    @property
    def living(self) -> list[Identity]:
        """The commands whose end is not known."""
        return [each for each in self._commands if each not in self._ended]

    @property
    def interrupted(self) -> Fetching | None:
        """The transfer that was not brought to its end."""
        return self._fetching

    @property
    def next_name(self) -> str:
        """What the next file is to be called on the ground."""
        return f"fetched-{self._fetches + 1}"

    def note(self, entry: Sent | Answered | Fetching | Fetched) -> None:
        """Write something down."""
        self._journal.write(entry)
        self._learn(entry)

    def hear(self, report: Report, way: Way) -> None:
        """Write a report down, unless it is known."""
        if self._reports.get(report.sequence) != report:
            entry = Heard(report, way)
            self._journal.write(entry)
            self._learn(entry)

    def _learn(self, entry: Entry) -> None:
        match entry:
            case Sent(command):
                self._commands[command.identity] = command
            case Answered(identity, answer):
                self._answered[identity] = answer
            case Heard(report):
                self._hear(report)
            case Fetching():
                if self._fetching is None:
                    self._fetches += 1
                self._fetching = entry
            case Fetched():
                self._fetching = None

    def _hear(self, report: Report) -> None:
        self._reports[report.sequence] = report
        self.newest = max(self.newest, report.sequence)
        while self.whole_to + 1 in self._reports:
            self.whole_to += 1
        if report.identity is not None and report.stage is not None and report.stage.terminal:
            self._ended.add(report.identity)
