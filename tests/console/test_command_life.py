"""What several consoles know of a command, together: whoever tells first."""

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from adapters.console.command_states import apply_stage, merge
from adapters.console.messages import CommandState, CommandStatus, LinkKind, StageEntry

SENT = CommandStatus(
    "drive", "jackal", "moveForward", {"distance": 1.0}, "anna", "anna", 7, LinkKind.DIRECT,
    CommandState.SENDING, False, 0.0, 10.0,
    (StageEntry("SENT", "console", 0.0, 0.0, "by anna"),),
)  # fmt: skip
RECEIVED = replace(SENT, id="jackal:anna:7", name="", args=None, deadline=None, history=())
ABOARD = [
    StageEntry(stage, "jackal", float(number), float(number), "", sequence=number, step=step)
    for number, (stage, step) in enumerate(
        [("RECEIVED", None), ("ACCEPTED", None), ("STARTED", None), ("PROGRESS", 1),
         ("PROGRESS", 2), ("EXECUTED", None)],
        start=1,
    )
]  # fmt: skip
UNCERTAIN = StageEntry("UNKNOWN", "console", 10.5, 10.5, "nothing was heard of it")
TAKEN = StageEntry("ACKNOWLEDGED", "jackal", 0.5, 0.5, "")


def after(command: CommandStatus, *stages: StageEntry) -> CommandStatus:
    for each in stages:
        command = apply_stage(command, each)
    return command


def lifecycle(command: CommandStatus) -> tuple[object, ...]:
    return command.state, command.ended, command.deadline, command.history


@st.composite
def received(draw: st.DrawFn, of: CommandStatus) -> CommandStatus:
    """Give a command as a console heard of it, which missed some and heard the rest later."""
    late = draw(st.floats(0.0, 0.4))
    stages = draw(st.lists(st.sampled_from([TAKEN, *ABOARD]), unique_by=id))
    stages.sort(key=lambda each: each.rx)
    return after(of, *(replace(each, rx=each.rx + late) for each in stages))


@given(received(SENT), received(RECEIVED), received(RECEIVED))
def test_the_result_is_independent_of_the_first_writer(
    one: CommandStatus, two: CommandStatus, three: CommandStatus
) -> None:
    merged = merge(merge(one, two), three)
    assert lifecycle(merge(merge(one, three), two)) == lifecycle(merged)
    assert lifecycle(merge(merge(three, two), one)) == lifecycle(merged)
    for each in (one, two, three):
        assert merge(merged, each) == merged
    assert (merged.by, merged.args) == ("anna", {"distance": 1.0})


@given(received(SENT))
def test_an_uncertainty_unknown_to_others_remains(one: CommandStatus) -> None:
    assert merge(one, one) == one
    assert merge(SENT, one) == one


def test_an_uncertainty_ends_with_a_later_report_at_another_console() -> None:
    uncertain = after(SENT, TAKEN, UNCERTAIN)
    assert merge(SENT, uncertain) == uncertain
    late = after(RECEIVED, replace(ABOARD[0], rx=11.0))
    assert merge(uncertain, late).state is CommandState.RECEIVED
    assert merge(after(RECEIVED, *ABOARD), uncertain).state is CommandState.EXECUTED
    started = merge(after(RECEIVED, *ABOARD[:3]), uncertain)
    assert (started.state, started.ended) == (CommandState.UNKNOWN, False)


def test_a_relay_that_has_it_lets_it_wait() -> None:
    taken = replace(TAKEN, node="orbiter")
    assert merge(SENT, after(SENT, taken)).deadline is None
    assert merge(SENT, after(SENT, TAKEN)).deadline == 10.0


def test_execution_by_the_asset_outweighs_its_refusal() -> None:
    refusal = StageEntry("REJECTED", "jackal", 0.5, 0.5, "the ledger cannot be written")
    answered = after(SENT, refusal)
    assert (answered.state, answered.ended) == (CommandState.REJECTED, True)
    assert after(answered, ABOARD[0]).state is CommandState.REJECTED
    started = after(answered, *ABOARD[:3])
    assert (started.state, started.ended) == (CommandState.STARTED, False)
    assert after(answered, *ABOARD).state is CommandState.EXECUTED
    assert merge(answered, after(RECEIVED, *ABOARD)).state is CommandState.EXECUTED
    notified = after(answered, replace(refusal, sequence=1))
    assert after(notified, *ABOARD).state is CommandState.REJECTED
