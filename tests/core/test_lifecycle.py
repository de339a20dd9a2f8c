from itertools import product

import pytest
from transitions import MachineError

from executive.commands import Command, MoveForward
from executive.commands.lifecycle import EDGES, CommandLifecycle, Event, StageDetails
from executive.values.reasons import Reason, Refusal
from executive.values.reports import Identity, Stage

COMMAND = Command(Identity("MOE", 1), MoveForward(1.0), "direct")
REFUSAL = Refusal(Reason.STOPPED, "stopped")


REPORTED = {Event.ACCEPT: (), Event.START: (), Event.ADVANCE: (1, 2, "half way"), Event.EXECUTE: ()}


def fire(lifecycle: CommandLifecycle, event: Event) -> None:
    getattr(lifecycle, event.value)(*REPORTED.get(event, (REFUSAL,)))


@pytest.mark.parametrize(("stage", "event"), list(product(Stage, Event)))
def test_every_event_in_every_stage_acts_as_in_the_table(stage: Stage, event: Event) -> None:
    reported: list[Stage] = []
    lifecycle = CommandLifecycle(COMMAND, lambda _, reached, __: reported.append(reached), stage)
    targets = [edge.target for edge in EDGES if (edge.source, edge.event) == (stage, event)]
    if targets:
        fire(lifecycle, event)
        assert [lifecycle.stage] == targets == reported
    else:
        with pytest.raises(MachineError):
            fire(lifecycle, event)
        assert lifecycle.stage is stage
        assert reported == []


def test_terminal_stages_are_those_without_an_exit() -> None:
    sources = {edge.source for edge in EDGES}
    assert {stage for stage in Stage if stage.terminal} == set(Stage) - sources


def test_notes_travel_with_their_stage() -> None:
    reported: list[tuple[Stage, StageDetails]] = []
    lifecycle = CommandLifecycle(COMMAND, lambda _, stage, note: reported.append((stage, note)))
    lifecycle.accept()
    lifecycle.start()
    lifecycle.advance(1, 3, "a third")
    lifecycle.fail(REFUSAL)
    assert reported[3] == (Stage.PROGRESS, StageDetails(text="a third", step=1, step_count=3))
    assert reported[4] == (Stage.FAILED, StageDetails(refusal=REFUSAL))


def test_an_event_fired_while_notifying_is_not_lost() -> None:
    reported: list[Stage] = []
    lifecycles: list[CommandLifecycle] = []

    def notify(_: Command, stage: Stage, __: StageDetails) -> None:
        reported.append(stage)
        if stage is Stage.ACCEPTED:
            lifecycles[0].start()

    lifecycles.append(CommandLifecycle(COMMAND, notify))
    lifecycles[0].accept()
    assert reported == [Stage.RECEIVED, Stage.ACCEPTED, Stage.STARTED]
