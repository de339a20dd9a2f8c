"""Plans and their journals in the ledger's file, written in the ledger's commits.

The journal of a plan says which of its steps were begun, and under which command. How a command
ended is known from the command itself, so that a step and its outcome are never at odds.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import astuple
from enum import Enum, unique
from typing import Final

from executive.commands import PlanArgument, PlanDefinition
from executive.commands.intake import SOURCE_PREFIX, source_of
from executive.record.ledger import TERMINAL_STAGES, Ledger
from executive.values.reports import Identity, PlanStatus, PlanUpdate, Stage

_SCHEMA: Final = """
CREATE TABLE IF NOT EXISTS plans (
    plan_id TEXT PRIMARY KEY, name TEXT NOT NULL, format TEXT NOT NULL, content BLOB NOT NULL,
    arguments TEXT NOT NULL, status INTEGER NOT NULL, utc_s REAL NOT NULL, node TEXT NOT NULL,
    done INTEGER NOT NULL, total INTEGER NOT NULL, text TEXT NOT NULL
);
CREATE TABLE IF NOT EXISTS plan_steps (
    plan_id TEXT NOT NULL, step TEXT NOT NULL, command_id INTEGER, outcome INTEGER,
    PRIMARY KEY (plan_id, step)
) WITHOUT ROWID;
"""


@unique
class StepOutcome(Enum):
    """What became of a step.

    Attributes:
        HALTED: the plan went on without it, and must again when the journal is replayed.
    """

    SUCCESS = 1
    FAILURE = 2
    HALTED = 3


class PlanStore:
    """The plans of one ledger."""

    def __init__(self, ledger: Ledger) -> None:
        self._ledger = ledger
        ledger.extend(_SCHEMA, self._settle_pruned)

    def plans(self) -> Sequence[PlanUpdate]:
        """Return how far each plan has come, in the order in which they were submitted."""
        rows = self._ledger.rows(
            "SELECT plan_id, status, utc_s, node, done, total, text FROM plans ORDER BY rowid"
        )
        return [PlanUpdate(plan_id, PlanStatus(status), *rest) for plan_id, status, *rest in rows]

    def definition(self, plan_id: str) -> PlanDefinition:
        """Return a plan as it was submitted, committing first."""
        self._ledger.commit()
        ((name, form, content, arguments),) = self._ledger.rows(
            "SELECT name, format, content, arguments FROM plans WHERE plan_id = ?", (plan_id,)
        )
        given = tuple(PlanArgument(*pair) for pair in json.loads(arguments))
        return PlanDefinition(plan_id, name, form, content, given)

    def add(self, definition: PlanDefinition, update: PlanUpdate) -> None:
        """Remember a new plan."""
        plan_id, name, form, content, given = astuple(definition)
        _, status, *rest = astuple(update)
        self._ledger.write(
            "INSERT INTO plans VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
            (plan_id, name, form, content, json.dumps(given), status.value, *rest),
        )

    def update(self, update: PlanUpdate) -> None:
        """Remember how far a plan has come."""
        plan_id, status, *rest = astuple(update)
        self._ledger.write(
            "UPDATE plans SET status = ?, utc_s = ?, node = ?, done = ?, total = ?, text = ?"
            " WHERE plan_id = ?",
            (status.value, *rest, plan_id),
        )

    def remove(self, plan_id: str) -> None:
        """Forget a plan."""
        self.forget(plan_id)
        self._ledger.write("DELETE FROM plans WHERE plan_id = ?", (plan_id,))

    def next_number(self, plan_id: str) -> int:
        """Return a number that no command of the plan, or of one before it of this id, had."""
        return self._ledger.last_number(source_of(plan_id)) + 1

    def begin(self, plan_id: str, step: str, command_id: int) -> None:
        """Remember under which command a step was begun."""
        self._ledger.write(
            "INSERT OR REPLACE INTO plan_steps VALUES (?, ?, ?, NULL)", (plan_id, step, command_id)
        )

    def settle(self, plan_id: str, step: str, outcome: StepOutcome) -> None:
        """Remember what became of a step that no command tells."""
        self._ledger.write(
            "INSERT OR REPLACE INTO plan_steps VALUES (?, ?, NULL, ?)",
            (plan_id, step, outcome.value),
        )

    def journal(self, plan_id: str) -> Mapping[str, StepOutcome]:
        """Return the steps of which it is known what became of them, committing first."""
        self._ledger.commit()
        rows = self._ledger.rows(
            "SELECT step, outcome, stage FROM plan_steps p LEFT JOIN stages s"
            " ON s.source = ? AND s.command_id = p.command_id WHERE plan_id = ?",
            (source_of(plan_id), plan_id),
        )
        return {step: _outcome(outcome, stage) for step, outcome, stage in rows}

    def commands(self, plan_id: str) -> Mapping[str, Identity]:
        """Return the steps that were begun, each with its command, as far as committed."""
        rows = self._ledger.rows(
            "SELECT step, command_id FROM plan_steps WHERE plan_id = ? AND command_id IS NOT NULL",
            (plan_id,),
        )
        return {step: Identity(source_of(plan_id), number) for step, number in rows}

    def forget_unfinished_steps(self, plan_id: str) -> None:
        """Forget the steps whose command has not ended by now, so that they are begun anew."""
        self._ledger.write(
            "DELETE FROM plan_steps WHERE plan_id = ? AND outcome IS NULL AND command_id NOT IN"
            f" (SELECT command_id FROM stages WHERE source = ? AND stage IN ({TERMINAL_STAGES}))",
            (plan_id, source_of(plan_id)),
        )

    def forget(self, plan_id: str) -> None:
        """Forget the journal."""
        self._ledger.write("DELETE FROM plan_steps WHERE plan_id = ?", (plan_id,))

    def _settle_pruned(self, identity: Identity, stage: Stage) -> None:
        """Write down what became of a step whose command will no longer tell."""
        if identity.source.startswith(SOURCE_PREFIX):
            self._ledger.write(
                "UPDATE plan_steps SET outcome = ? WHERE plan_id = ? AND command_id = ?"
                " AND outcome IS NULL",
                (
                    _outcome(None, stage.value).value,
                    identity.source.removeprefix(SOURCE_PREFIX),
                    identity.command_id,
                ),
            )


def _outcome(outcome: int | None, stage: int | None) -> StepOutcome:
    if outcome is not None:
        return StepOutcome(outcome)
    return StepOutcome.SUCCESS if stage == Stage.EXECUTED.value else StepOutcome.FAILURE
