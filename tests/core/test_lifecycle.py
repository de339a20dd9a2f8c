from itertools import product

import pytest
from transitions import MachineError

from executive.commands import Command, MoveForward
from executive.commands.lifecycle import EDGES, CommandLifecycle, Event, StageDetails
from executive.values.reasons import Reason, Refusal
from executive.values.reports import Identity, Stage

COMMAND = Command(Identity("MOE", 1), MoveForward(1.0), "direct")
REFUSAL = Refusal(Reason.STOPPED, "stopped")


TOLD = {Event.ACCEPT: (), Event.START: (), Event.ADVANCE: (1, 2, "half way"), Event.EXECUTE: ()}


def fire(life: CommandLifecycle, event: Event) -> None:
    getattr(life, event.value)(*TOLD.get(event, (REFUSAL,)))


@pytest.mark.parametrize(("stage", "event"), list(product(Stage, Event)))
def test_every_event_in_every_stage_does_what_the_table_says(stage: Stage, event: Event) -> None:
    told: list[Stage] = []
    life = CommandLifecycle(COMMAND, lambda _, reached, __: told.append(reached), stage)
    targets = [edge.target for edge in EDGES if (edge.source, edge.event) == (stage, event)]
    if targets:
        fire(life, event)
        assert [life.stage] == targets == told
    else:
        with pytest.raises(MachineError):
            fire(life, event)
        assert life.stage is stage
        assert told == []


def test_terminal_stages_are_those_without_a_way_out() -> None:
    sources = {edge.source for edge in EDGES}
    assert {stage for stage in Stage if stage.terminal} == set(Stage) - sources


def test_notes_travel_with_their_stage() -> None:
    told: list[tuple[Stage, StageDetails]] = []
    life = CommandLifecycle(COMMAND, lambda _, stage, note: told.append((stage, note)))
    life.accept()
    life.start()
    life.advance(1, 3, "a third")
    life.fail(REFUSAL)
    assert told[3] == (Stage.PROGRESS, StageDetails(text="a third", step=1, step_count=3))
    assert told[4] == (Stage.FAILED, StageDetails(refusal=REFUSAL))


def test_an_event_fired_while_notifying_is_not_lost() -> None:
    told: list[Stage] = []
    lives: list[CommandLifecycle] = []

    def notify(_: Command, stage: Stage, __: StageDetails) -> None:
        told.append(stage)
        if stage is Stage.ACCEPTED:
            lives[0].start()

    lives.append(CommandLifecycle(COMMAND, notify))
    lives[0].accept()
    assert told == [Stage.RECEIVED, Stage.ACCEPTED, Stage.STARTED]
