"""`PlanStore`: plans and their states in the ledger's file, written in the ledger's commits.

A running plan has one row with its state, which is replaced. Plans of version 0.1 have a journal of
their started steps instead, which is read and not written any longer. The result of a command is
read from the command itself, so that a step and its outcome cannot disagree.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from enum import Enum, unique
from typing import Final

from executive.commands import PlanArgument, PlanDefinition
from executive.commands.intake import SOURCE_PREFIX, source_of
from executive.record.ledger import TERMINAL_STAGES, Ledger
from executive.values.reports import Identity, PlanStatus, PlanUpdate, Report, Stage

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
CREATE TABLE IF NOT EXISTS plan_states (
    plan_id TEXT PRIMARY KEY, digest TEXT NOT NULL, utc_s REAL NOT NULL,
    suspended INTEGER NOT NULL, state TEXT NOT NULL
) WITHOUT ROWID;
"""


@unique
class StepOutcome(Enum):
    """Outcome of a step.

    Attributes:
        HALTED: the plan continued without it, and must again when the journal is replayed.
        SKIPPED: an operator resumed the plan at a later step.
    """

    SUCCESS = 1
    FAILURE = 2
    HALTED = 3
    SKIPPED = 4


@dataclass(frozen=True, slots=True)
class StoredState:
    """State of a plan as it is stored.

    Attributes:
        digest: digest of the plan that has the state.
        utc_s: when it was stored, seconds since 1970-01-01 UTC.
        suspended: whether the plan's timers are stopped.
        text: the state; see `executive.plans.state`.
    """

    digest: str
    utc_s: float
    suspended: bool
    text: str


class PlanStore:
    """The plans of one ledger; texts and states of plans are known before they are committed."""

    def __init__(self, ledger: Ledger) -> None:
        self._ledger = ledger
        self._unwritten: dict[str, tuple[int, PlanDefinition]] = {}
        self._states: dict[str, tuple[int, StoredState | None]] = {}
        ledger.add_tables(_SCHEMA, self._settle_pruned)

    @property
    def last_batch(self) -> int:
        """Number of the batch of the ledger with the last write."""
        return self._ledger.last_batch

    def is_durable(self, batch: int) -> bool:
        """Return whether a batch of the ledger is committed."""
        return batch <= self._ledger.state.durable

    def plans(self) -> Sequence[PlanUpdate]:
        """Return the progress of each plan, in the order of submission."""
        rows = self._ledger.rows(
            "SELECT plan_id, status, utc_s, node, done, total, text FROM plans ORDER BY rowid"
        )
        return [PlanUpdate(plan_id, PlanStatus(status), *rest) for plan_id, status, *rest in rows]

    def definition(self, plan_id: str) -> PlanDefinition:
        """Return a plan as submitted."""
        batch, unwritten = self._unwritten.get(plan_id, (0, None))
        if unwritten is not None and not self.is_durable(batch):
            return unwritten
        self._unwritten.pop(plan_id, None)
        ((name, form, content, arguments),) = self._ledger.rows(
            "SELECT name, format, content, arguments FROM plans WHERE plan_id = ?", (plan_id,)
        )
        given = tuple(PlanArgument(*pair) for pair in json.loads(arguments))
        return PlanDefinition(plan_id, name, form, content, given)

    def add(self, definition: PlanDefinition, update: PlanUpdate) -> None:
        """Add a new plan to the next commit."""
        plan_id, name, form, content, given = astuple(definition)
        _, status, *rest = astuple(update)
        self._ledger.write(
            "INSERT INTO plans VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
            (plan_id, name, form, content, json.dumps(given), status.value, *rest),
        )
        self._unwritten[plan_id] = self.last_batch, definition

    def update(self, update: PlanUpdate) -> None:
        """Add the progress of a plan to the next commit."""
        plan_id, status, *rest = astuple(update)
        self._ledger.write(
            "UPDATE plans SET status = ?, utc_s = ?, node = ?, done = ?, total = ?, text = ?"
            " WHERE plan_id = ?",
            (status.value, *rest, plan_id),
        )

    def remove(self, plan_id: str) -> None:
        """Delete a plan."""
        self.forget(plan_id)
        self._ledger.write("DELETE FROM plans WHERE plan_id = ?", (plan_id,))

    def next_number(self, plan_id: str) -> int:
        """Return a number not used by commands of this plan, or of an earlier plan of this id."""
        return self._ledger.last_command_id(source_of(plan_id)) + 1

    def save_state(self, plan_id: str, state: StoredState) -> None:
        """Replace the state of a plan in the next commit."""
        self._ledger.write(
            "INSERT OR REPLACE INTO plan_states VALUES (?, ?, ?, ?, ?)",
            (plan_id, state.digest, state.utc_s, state.suspended, state.text),
        )
        self._note(plan_id, state)

    def state(self, plan_id: str) -> StoredState | None:
        """Return the state of a plan; None if it has none."""
        batch, unwritten = self._states.get(plan_id, (0, None))
        if not self.is_durable(batch):
            return unwritten
        rows = self._ledger.rows(
            "SELECT digest, utc_s, suspended, state FROM plan_states WHERE plan_id = ?", (plan_id,)
        )
        for digest, utc_s, suspended, text in rows:
            return StoredState(digest, utc_s, bool(suspended), text)
        return None

    def awaits_restart(self, plan_id: str) -> bool:
        """Return whether a suspended plan was to continue by itself: its timers are not stopped."""
        stored = self.state(plan_id)
        return stored is not None and not stored.suspended

    def stop_timers(self, plan_id: str) -> None:
        """Stop the timers of a plan, from the time of its state on."""
        self._ledger.write("UPDATE plan_states SET suspended = 1 WHERE plan_id = ?", (plan_id,))
        _, unwritten = self._states.get(plan_id, (0, None))
        if unwritten is not None:
            self._note(plan_id, replace(unwritten, suspended=True))

    def last_report(self, plan_id: str, command_id: int) -> Report | None:
        """Return the last report on the life cycle of a plan's command, if it is stored."""
        return self._ledger.last_report(Identity(source_of(plan_id), command_id))

    def journal(self, plan_id: str) -> Mapping[str, StepOutcome]:
        """Return the steps with a committed outcome."""
        rows = self._ledger.rows(
            "SELECT step, outcome, stage FROM plan_steps p LEFT JOIN stages s"
            " ON s.source = ? AND s.command_id = p.command_id WHERE plan_id = ?",
            (source_of(plan_id), plan_id),
        )
        return {step: _outcome(outcome, stage) for step, outcome, stage in rows}

    def forget_unfinished_steps(self, plan_id: str) -> None:
        """Delete the steps with an unfinished command, so that they start again."""
        self._ledger.write(
            "DELETE FROM plan_steps WHERE plan_id = ? AND outcome IS NULL AND command_id NOT IN"
            f" (SELECT command_id FROM stages WHERE source = ? AND stage IN ({TERMINAL_STAGES}))",
            (plan_id, source_of(plan_id)),
        )

    def end(self, plan_id: str, final: StoredState | None) -> None:
        """Delete the journal; replace the state by a final one, if it is given."""
        self._ledger.write("DELETE FROM plan_steps WHERE plan_id = ?", (plan_id,))
        if final is not None:
            self.save_state(plan_id, final)

    def forget(self, plan_id: str) -> None:
        """Delete the state and the journal."""
        for table in ("plan_states", "plan_steps"):
            self._ledger.write(f"DELETE FROM {table} WHERE plan_id = ?", (plan_id,))
        self._note(plan_id, None)

    def _note(self, plan_id: str, state: StoredState | None) -> None:
        """Note the state of the last write, and forget those that are committed."""
        self._states = {i: at for i, at in self._states.items() if not self.is_durable(at[0])}
        self._states[plan_id] = self.last_batch, state

    def _settle_pruned(self, identity: Identity, stage: Stage) -> None:
        """Store the outcome of a step before its command is pruned."""
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
