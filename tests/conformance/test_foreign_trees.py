"""Trees as Groot2, Nav2 and ROS 2 wrappers write them load, or name a line and a remedy."""

import pytest

from executive.commands import PlanDefinition
from executive.plans import PlanRoot, nodes, read_plan
from executive.values.reasons import Refusal

COMMAND = '<takePicture deadline_s="20"/>'


def read(text: str) -> PlanRoot | Refusal:
    return read_plan(PlanDefinition("foreign", "A tree", "BTCPP4", text.encode(), ()))


def refusal_of(text: str) -> str:
    found = read(text)
    assert isinstance(found, Refusal), found
    return found.text


def file_of(body: str, head: str = 'BTCPP_format="4" main_tree_to_execute="Main"') -> str:
    """Return a file whose node of interest is in line 4."""
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<root {head}>\n'
        f'  <BehaviorTree ID="Main">\n{body}\n  </BehaviorTree>\n</root>\n'
    )


def test_a_file_of_groot2_loads_with_its_models_and_remarks() -> None:
    plan = read(
        """<?xml version="1.0" encoding="UTF-8"?>
<root BTCPP_format="4" main_tree_to_execute="Day">
  <BehaviorTree ID="Day" _description="out and back" _favorite="true">
    <Sequence name="the day" _uid="1">
      <Action ID="takePicture" name="first" deadline_s="20" _fullpath="Day/first" _uid="2"/>
      <SubTree ID="Look" pan="0.5" _collapsed="true" _autoremap="false"/>
      <ForceSuccess _uid="4">
        <Control ID="Fallback" _description="&lt;b&gt;try&lt;/b&gt;">
          <Condition ID="Near" x="0" y="0" within="1"/>
          <Decorator ID="Inverter">
            <takePicture name="second" deadline_s="20"/>
          </Decorator>
        </Control>
      </ForceSuccess>
    </Sequence>
  </BehaviorTree>
  <BehaviorTree ID="Look">
    <setCameraAngles pan="{pan}" tilt="{tilt}" deadline_s="15"/>
  </BehaviorTree>
  <!-- Description of Node Models (used by Groot) -->
  <TreeNodesModel>
    <Action ID="takePicture" editable="true">
      <input_port name="deadline_s" type="double">time limit</input_port>
    </Action>
    <SubTree ID="Look">
      <input_port name="pan" default="0"/>
      <input_port name="tilt" default="-0.1">downward</input_port>
    </SubTree>
  </TreeNodesModel>
</root>"""
    )
    assert isinstance(plan, PlanRoot), plan
    kinds = [each.kind.name for each in nodes(plan)]
    assert kinds == [
        *("SubTree", "Sequence", "takePicture", "SubTree", "setCameraAngles"),
        *("ForceSuccess", "Fallback", "Near", "Inverter", "takePicture"),
    ]


REFUSED = {
    "RecoveryNode": (
        f'<RecoveryNode number_of_retries="6">{COMMAND}<AlwaysSuccess/></RecoveryNode>',
        "RetryUntilSuccessful",
    ),
    "RateController": (f'<RateController hz="1.0">{COMMAND}</RateController>', "Delay"),
    "PipelineSequence": (
        f"<PipelineSequence>{COMMAND}{COMMAND}</PipelineSequence>",
        "ReactiveSequence",
    ),
    "RoundRobin": (f"<RoundRobin>{COMMAND}{COMMAND}</RoundRobin>", "SequenceWithMemory"),
    "Control ID=RecoveryNode": (
        f'<Control ID="RecoveryNode" number_of_retries="1">{COMMAND}{COMMAND}</Control>',
        "RetryUntilSuccessful",
    ),
    "ManualSelector": (f"<ManualSelector>{COMMAND}{COMMAND}</ManualSelector>", "Ask"),
    "WaitValueUpdate": (
        f'<WaitValueUpdate entry="{{x}}">{COMMAND}</WaitValueUpdate>',
        "WaitFor",
    ),
    "ConsumeQueue": (f'<ConsumeQueue queue="{{q}}">{COMMAND}</ConsumeQueue>', "LoopString"),
    "LoopInt": (f'<LoopInt queue="1;2" value="{{n}}">{COMMAND}</LoopInt>', "LoopDouble"),
    "SequenceStar": (f"<SequenceStar>{COMMAND}</SequenceStar>", "SequenceWithMemory"),
    "endless loop": (
        f"<KeepRunningUntilFailure>{COMMAND}</KeepRunningUntilFailure>",
        "below a Timeout",
    ),
    "endless Repeat": (f'<Repeat num_cycles="-1">{COMMAND}</Repeat>', "below a Timeout"),
    "misspelt condition": (f'<Sequence _skipif="1 == 1">{COMMAND}</Sequence>', "_skipIf"),
    "misspelt node": (f"<Sequnce>{COMMAND}</Sequnce>", "did you mean Sequence"),
    "node of another library": (
        f'<ForEachUntilSuccess vector_in="{{v}}">{COMMAND}</ForEachUntilSuccess>',
        "did you mean ForceSuccess",
    ),
    "node like no other": (f"<Xyz>{COMMAND}</Xyz>", "rover plan nodes"),
    "attribute like no other": (f'<Sequence timeout="9">{COMMAND}</Sequence>', "remove it"),
    "attribute of an editor": (f'<Sequence _external="1">{COMMAND}</Sequence>', "remove it"),
    "tree of another file": ('<SubTree ID="Elsewhere"/>', "no tree"),
    "external argument": (
        f'<Repeat num_cycles="{{times}}">{COMMAND}</Repeat>',
        "give --arg times=VALUE",
    ),
    "text in double quotes": (
        f'<Precondition if="mode == &quot;x&quot;">{COMMAND}</Precondition>',
        "is no part of a script",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_does_not_load_is_refused_with_its_line_and_a_remedy(name: str) -> None:
    body, remedy = REFUSED[name]
    text = refusal_of(file_of(body))
    assert text.startswith("line 4: ")
    assert remedy in text


@pytest.mark.parametrize(
    ("text", "line", "remedy"),
    [
        (file_of(COMMAND, 'main_tree_to_execute="Main"'), 2, 'BTCPP_format="4"'),
        (file_of(COMMAND, 'BTCPP_format="3" main_tree_to_execute="Main"'), 2, 'BTCPP_format="4"'),
        (file_of(COMMAND, 'BTCPP_format="4" main_tree_to_execute="Mian"'), 2, "did you mean Main"),
        (file_of(COMMAND).replace("</root>", '<include path="more.xml"/>\n</root>'), 6, "one file"),
    ],
    ids=["version 3", "format 3", "unknown main tree", "include"],
)
def test_a_root_that_does_not_load_is_refused_with_its_line_and_a_remedy(
    text: str, line: int, remedy: str
) -> None:
    found = refusal_of(text)
    assert found.startswith(f"line {line}: ")
    assert remedy in found
