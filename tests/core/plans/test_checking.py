from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.commands import (
    CommandDeclaration,
    MoveForward,
    PlanArgument,
    PlanDefinition,
    SubmitPlan,
    Waypoint,
)
from executive.commands.lifecycle import Accepted
from executive.plans import LEAVES, check_plan, steps
from executive.settings import load_settings
from executive.values.reasons import Reason, Refusal
from tests.support.kinematic import Bench
from tests.support.plans import plan, xml

SETTINGS = load_settings("jackal")
GO = '<moveForward distance="1" deadline_s="9"/>'
MPC = '<moveTo x="1" y="2" controller="mpc" deadline_s="9"/>'
VALUES = {float: "0.5", int: "1", str: "a/b.jpg", Waypoint: "1,0;1,1,1.57;"}


def refusal(definition: PlanDefinition) -> Refusal:
    found = check_plan(definition, SETTINGS)
    assert isinstance(found, Refusal), found
    return found


@pytest.mark.parametrize("leaf", LEAVES.values(), ids=lambda leaf: leaf.name)
def test_every_leaf_is_made_of_its_parameters(leaf: CommandDeclaration) -> None:
    needed = [each for each in leaf.user_arguments if not each.optional]
    given_ = " ".join(f'{parameter.name}="{VALUES[parameter.kind]}"' for parameter in needed)
    for form in (f"<{leaf.name} {given_} {{}}/>", f'<Action ID="{leaf.name}" {given_} {{}}/>'):
        root = check_plan(plan(form.format('deadline_s="9"')), SETTINGS)
        assert not isinstance(root, Refusal), root
        assert [step.deadline_s for step in steps(root)] == [9.0]
        assert refusal(plan(form.format(""))).reason is Reason.PLAN_NO_DEADLINE
    for parameter in needed:
        others = " ".join(
            f'{other.name}="{VALUES[other.kind]}"' for other in needed if other != parameter
        )
        found = refusal(plan(f'<{leaf.name} {others} deadline_s="9"/>'))
        assert found.reason is Reason.PLAN_BAD_ARGUMENT
        assert f"needs {parameter.name}" in found.text


FAULTS = [
    ("<Sequence>\n<fly/></Sequence>", Reason.PLAN_UNKNOWN_NODE, 4, "unknown node 'fly'"),
    ("<ReactiveSequence/>", Reason.PLAN_STRUCTURE, 3, "ReactiveSequence needs at least 1 child"),
    ("<ManualSelector/>", Reason.PLAN_UNKNOWN_NODE, 3, "Ask"),
    ("<RecoveryNode/>", Reason.PLAN_UNKNOWN_NODE, 3, "use RetryUntilSuccessful around a Fallback"),
    ("<RateController/>", Reason.PLAN_UNKNOWN_NODE, 3, "use Repeat with a Delay"),
    ("<PipelineSequence/>", Reason.PLAN_UNKNOWN_NODE, 3, "use ReactiveSequence"),
    ("<stop/>", Reason.PLAN_UNKNOWN_NODE, 3, "a plan cannot stop the rover"),
    ('<Action ID="resume"/>', Reason.PLAN_UNKNOWN_NODE, 3, "mission control does"),
    ('<SubTree ID="Mian"/>', Reason.PLAN_UNKNOWN_NODE, 3, "no tree 'Mian': did you mean Main?"),
    (GO.replace("distance", "distanse"), Reason.PLAN_BAD_ARGUMENT, 3, "did you mean distance?"),
    (GO.replace("1", "45deg"), Reason.PLAN_BAD_ARGUMENT, 3, "'45deg' is not a number in m"),
    ('<moveTO x="1" y="2"/>', Reason.PLAN_UNKNOWN_NODE, 3, "did you mean moveTo?"),
    ('<SubTree ID="Other"/>', Reason.PLAN_UNKNOWN_NODE, 3, "no tree 'Other'"),
    ('<SubTree ID="Main"/>', Reason.PLAN_STRUCTURE, 3, "contains itself"),
    ("<SubTree/>", Reason.PLAN_BAD_ARGUMENT, 3, "ID"),
    ("<Action/>", Reason.PLAN_BAD_ARGUMENT, 3, "ID"),
    ('<moveForward distance="1"/>', Reason.PLAN_NO_DEADLINE, 3, "deadline_s"),
    ('<moveForward deadline_s="9"/>', Reason.PLAN_BAD_ARGUMENT, 3, "needs distance"),
    ('<moveForward distance="far" deadline_s="9"/>', Reason.PLAN_BAD_ARGUMENT, 3, "not a number"),
    ('<moveForward distance="nan" deadline_s="9"/>', Reason.PLAN_BAD_ARGUMENT, 3, "not a number"),
    ('<moveForward distance="1e999" deadline_s="9"/>', Reason.PLAN_BAD_ARGUMENT, 3, "number"),
    ('<moveForward distance="500" deadline_s="9"/>', Reason.PLAN_BAD_ARGUMENT, 3, "above its"),
    ('<moveForward distance="{d}" deadline_s="9"/>', Reason.PLAN_BAD_ARGUMENT, 3, "{d}"),
    ('<moveForward distance="1" deadline_s="0"/>', Reason.PLAN_BAD_ARGUMENT, 3, "deadline_s"),
    (GO.replace("/", ' speed="1"/'), Reason.PLAN_BAD_ARGUMENT, 3, "'speed'"),
    (GO.replace("/", ' _skipIf="a"/'), Reason.PLAN_BAD_ARGUMENT, 3, "column 1: nothing sets a"),
    (GO.replace("/", ' _skipif="1"/'), Reason.PLAN_BAD_ARGUMENT, 3, "did you mean _skipIf?"),
    (GO.replace("/", ' name="a/b"/'), Reason.PLAN_BAD_ARGUMENT, 3, "slash"),
    (GO.replace("/", "") + GO + "</moveForward>", Reason.PLAN_STRUCTURE, 3, "no children"),
    ('<followPath waypoints="1,2,3,4" deadline_s="9"/>', Reason.PLAN_BAD_ARGUMENT, 3, "x,y"),
    ('<moveTo x="1" y="2" controller="mcp"/>', Reason.PLAN_BAD_ARGUMENT, 3, "did you mean mpc?"),
    (MPC, Reason.PLAN_BAD_ARGUMENT, 3, "controller mpc: jackal does not offer it"),
    ('<deleteFile path="../x" deadline_s="9"/>', Reason.PLAN_BAD_ARGUMENT, 3, "leaves the"),
    ("<Sequence/>", Reason.PLAN_STRUCTURE, 3, "needs at least 1 child"),
    (f"<Inverter>{GO}{GO}</Inverter>", Reason.PLAN_STRUCTURE, 3, "exactly 1 child"),
    (f"<Repeat>{GO}</Repeat>", Reason.PLAN_BAD_ARGUMENT, 3, "num_cycles"),
    (f'<Repeat num_cycles="-1">{GO}</Repeat>', Reason.PLAN_BAD_ARGUMENT, 3, "every plan ends"),
    (f'<Timeout msec="1.5">{GO}</Timeout>', Reason.PLAN_BAD_ARGUMENT, 3, "not a whole number"),
    (f'<Parallel success_count="2">{GO}</Parallel>', Reason.PLAN_BAD_ARGUMENT, 3, "1 children"),
    ("<Sequence>\n\n<Fallback></Sequence>", Reason.PLAN_NOT_XML, 5, "mismatched tag"),
]  # fmt: skip


@pytest.mark.parametrize(("body", "reason", "line", "text"), FAULTS)
def test_a_fault_is_reported_with_its_line(body: str, reason: Reason, line: int, text: str) -> None:
    found = refusal(plan(body))
    assert (found.reason, found.argument) == (reason, 1)
    assert found.text.startswith(f"line {line}: ")
    assert text in found.text
    assert found.figures[0].value == line


NO_PLANS = [
    (b"", Reason.PLAN_NOT_XML),
    (b"hello", Reason.PLAN_NOT_XML),
    (xml(GO).replace(b"<root", b"<!DOCTYPE r [<!ENTITY a 'b'>]><root"), Reason.PLAN_NOT_XML),
    (b"<tree/>", Reason.PLAN_STRUCTURE),
    (b"<root/>", Reason.PLAN_FORMAT),
    (xml(GO).replace(b'="4"', b'="3"'), Reason.PLAN_FORMAT),
    (b'<root BTCPP_format="4"/>', Reason.PLAN_STRUCTURE),
    (xml(GO).replace(b"<root", b'<root after_restrt="resume"'), Reason.PLAN_BAD_ARGUMENT),
    (xml(GO).replace(b'"Main">\n<Beh', b'"Other">\n<Beh'), Reason.PLAN_STRUCTURE),
    (xml(GO, '<include path="/etc/passwd"/>'), Reason.PLAN_UNKNOWN_NODE),
    (xml(GO, '<BehaviorTree ID="Main"><x/></BehaviorTree>'), Reason.PLAN_STRUCTURE),
    (xml(GO, '<BehaviorTree ID="Unused"><x/></BehaviorTree>'), Reason.PLAN_UNKNOWN_NODE),
    (xml(GO, "<!--" + "x" * 300_000 + "-->"), Reason.PLAN_TOO_LARGE),
    (xml("<Sequence>" + GO * 600 + "</Sequence>"), Reason.PLAN_TOO_LARGE),
    (xml("<Inverter>" * 70 + GO + "</Inverter>" * 70), Reason.PLAN_TOO_LARGE),
    (xml('<Repeat num_cycles="1000">' * 2 + GO + "</Repeat>" * 2), Reason.PLAN_TOO_LARGE),
]


@pytest.mark.parametrize(("content", "reason"), NO_PLANS, ids=range(len(NO_PLANS)))
def test_a_text_that_is_no_plan_is_refused(content: bytes, reason: Reason) -> None:
    assert refusal(replace(plan(GO), content=content)).reason is reason


def test_attributes_of_editors_on_the_root_are_passed_over() -> None:
    remarks = b'<root project_name="P" xmlns:x="y" x:z="" _description="" after_restart="suspend"'
    root = check_plan(replace(plan(GO), content=xml(GO).replace(b"<root", remarks)), SETTINGS)
    assert not isinstance(root, Refusal), root
    misspelt = xml(GO).replace(b"<root", b'<root after_restrt="resume"')
    found = refusal(replace(plan(GO), content=misspelt))
    assert "'after_restrt' of <root>: did you mean after_restart?" in found.text


def test_a_rover_refuses_an_invalid_plan(bench: Bench) -> None:
    bodies = [(plan(body), reason) for body, reason, *_ in FAULTS]
    texts = [(replace(plan(GO), content=content), reason) for content, reason in NO_PLANS]
    others = [
        (plan(GO, "a b"), Reason.BAD_IDENTIFIER),
        (replace(plan(GO), format="SCXML"), Reason.PLAN_FORMAT),
        (plan(GO, far="1"), Reason.PLAN_BAD_ARGUMENT),
    ]
    for number, (definition, reason) in enumerate([*bodies, *texts, *others], 1):
        assert bench.refusal(SubmitPlan(definition), number).reason is reason


def spaced(spaces: str, length: int) -> str:
    return f'<followPath waypoints="{spaces:{length}}" deadline_s="9"/>'


def sized(octets: int) -> bytes:
    return xml(GO, f"<!--{'x' * (octets - len(xml(GO, '<!---->')))}-->")


def looped(times: int, leaves: int) -> str:
    return f'<Repeat num_cycles="{times}"><Sequence>{GO * leaves}</Sequence></Repeat>'


def named(length: int) -> str:
    return GO.replace("/", f' name="{"n" * length}"/')


def limited(msec: int) -> str:
    return f'<Timeout msec="{msec}">{GO}</Timeout>'


@pytest.mark.parametrize(
    ("within", "beyond", "text"),
    [
        (sized(256 * 1024), sized(256 * 1024 + 1), "262144 at most"),
        (
            xml(GO, f'<BehaviorTree ID="T"><Sequence>{GO * 3995}</Sequence></BehaviorTree>'),
            xml(GO, f'<BehaviorTree ID="T"><Sequence>{GO * 3996}</Sequence></BehaviorTree>'),
            "4000 elements at most",
        ),
        (
            xml("<Inverter>" * 61 + GO + "</Inverter>" * 61),
            xml("<Inverter>" * 62 + GO + "</Inverter>" * 62),
            "64 deep at most",
        ),
        (
            xml(f"<Sequence>{GO * 498}</Sequence>"),
            xml(f"<Sequence>{GO * 499}</Sequence>"),
            "500 nodes at most",
        ),
        (xml(looped(1000, 10)), xml(looped(1000, 11)), "10000 at most"),
        (xml(looped(1000, 1)), xml(looped(1001, 1)), "1 to 1000"),
        (xml(GO.replace("9", "86400")), xml(GO.replace("9", "86400.01")), "86400 at most"),
        (xml(limited(86_400_000)), xml(limited(86_400_001)), "86400000 at most"),
        (xml(limited(1)), xml(limited(0)), "above 0"),
        (xml(named(80)), xml(named(81)), "1 to 80 printable characters"),
        (xml(spaced("1,0", 16_384)), xml(spaced("1,0", 16_385)), "16384 at most"),
        (xml(spaced("1,0;" * 100, 0)), xml(spaced("1,0;" * 101, 0)), "bound of 100"),
        (xml(GO), xml(spaced("1,0;" * 200, 0)), "bound of 100"),
        (xml(GO), xml(spaced("1,0;" * 201, 0)), "200 at most"),
        (xml(GO), xml(GO.replace('"1"', '"{d"')), "'{d' is not a number"),
        (xml('<moveTo x="5000" y="0" deadline_s="9"/>'), xml(GO.replace("1", "101")), "101 m"),
    ],
)
def test_a_rover_takes_a_plan_up_to_each_bound(
    bench: Bench, within: bytes, beyond: bytes, text: str
) -> None:
    assert isinstance(bench.submit(SubmitPlan(replace(plan(""), content=within)), 1), Accepted)
    other = replace(plan("", "other"), content=beyond)
    assert text in bench.refusal(SubmitPlan(other), 2).text


def test_a_wrong_name_of_a_tree_is_held_against_the_first_of_many_alone(bench: Bench) -> None:
    trees = [f"x{number:03}" for number in range(220)]
    for number, (offset, message) in enumerate(((100, True), (210, False)), 1):
        names = [*trees[:offset], "Landing", *trees[offset:]]
        others = "".join(f'<BehaviorTree ID="{name}">{GO}</BehaviorTree>' for name in names)
        requested = SubmitPlan(plan('<SubTree ID="Landng"/>', others=others))
        assert ("did you mean Landing?" in bench.refusal(requested, number).text) is message


def test_subtrees_cannot_grow_without_end() -> None:
    twice = '<Sequence><SubTree ID="T{0}"/><SubTree ID="T{0}"/></Sequence>'
    trees = [f'<BehaviorTree ID="T{k}">{twice.format(k + 1)}</BehaviorTree>' for k in range(40)]
    last = f'<BehaviorTree ID="T40">{GO}</BehaviorTree>'
    found = refusal(plan('<SubTree ID="T0"/>', others="".join([*trees, last])))
    assert found.reason is Reason.PLAN_TOO_LARGE


def test_loops_without_a_command_do_not_delay_a_check() -> None:
    script = '<Script code="x := 1"/>'
    for _ in range(5):
        script = f'<Repeat num_cycles="1000">{script}</Repeat>'
    found = refusal(plan(f"<Sequence>{script}{GO}</Sequence>"))
    assert found.reason is Reason.PLAN_TOO_LARGE


def test_scripts_are_bounded_after_subtrees_are_expanded() -> None:
    terms = "-".join(["1"] * 150)
    script = f'<Script code="x := {terms}"/>'
    assert not isinstance(check_plan(plan(f"<Sequence>{script}{GO}</Sequence>"), SETTINGS), Refusal)
    tree = f'<BehaviorTree ID="T">{script}</BehaviorTree>'
    twice = '<SubTree ID="T"/>' * 100
    found = refusal(plan(f"<Sequence>{twice}{GO}</Sequence>", others=tree))
    assert found.text.endswith("a plan has 10000 operations in scripts at most")


@pytest.mark.parametrize(
    "copied",
    ["{nothing}", "{@nothing}", "{}", "{true}", "{@}", "{a b}", "{{x}}", "{" + "a" * 70 + "}"],
)
def test_a_copy_of_what_nothing_sets_is_refused(copied: str) -> None:
    copy = f'<Sequence><SetBlackboard value="{copied}" output_key="x"/>{GO}</Sequence>'
    assert "value" in refusal(plan(copy)).text


def test_telemetry_can_be_copied() -> None:
    copy = f'<Sequence><SetBlackboard value="{{@BATERY_VOLTAGE}}" output_key="x"/>{GO}</Sequence>'
    assert not isinstance(check_plan(plan(copy), SETTINGS), Refusal)


def test_an_argument_does_not_replace_telemetry() -> None:
    body = f'<Sequence><ScriptCondition code="@BATERY_VOLTAGE &gt; 2"/>{GO}</Sequence>'
    found = refusal(plan(body, BATERY_VOLTAGE="1000"))
    assert found.text == "a script reads the telemetry @BATERY_VOLTAGE: rename the argument"


def test_an_argument_that_nothing_reads_is_refused() -> None:
    leaf = '<moveForward distance="{far}" deadline_s="{=}"/>'
    assert not isinstance(check_plan(plan(leaf, far="1", deadline_s="9"), SETTINGS), Refusal)
    found = refusal(plan(leaf, far="1", deadline_s="9", fra="2"))
    assert found.reason is Reason.PLAN_BAD_ARGUMENT
    assert found.text == "no node reads the argument 'fra': did you mean far?"


@pytest.mark.parametrize(
    ("spaces", "fault"), [(150_000, "characters"), (201, "201 waypoints, 200 at most")]
)
def test_no_argument_makes_a_plan_large(spaces: int, fault: str) -> None:
    leaf = '<followPath waypoints="{p}" deadline_s="9"/>'
    found = refusal(plan(f"<Sequence>{leaf * 400}</Sequence>", p="0,0;" * spaces))
    assert found.reason is Reason.PLAN_BAD_ARGUMENT
    assert fault in found.text


@pytest.mark.parametrize("plan_id", ["", "a b", "a/b", "x" * 65, "é"])
def test_a_plan_needs_an_id_that_can_name_it(plan_id: str) -> None:
    assert refusal(plan(GO, plan_id)).reason is Reason.BAD_IDENTIFIER


def test_another_format_is_refused() -> None:
    assert refusal(replace(plan(GO), format="SCXML")).reason is Reason.PLAN_FORMAT


def test_a_plan_of_an_editor_is_taken_as_it_is() -> None:
    groot = """<?xml version="1.0" encoding="UTF-8"?>
<root BTCPP_format="4">
  <BehaviorTree ID="Look" _fullpath="Look::0">
    <Control ID="Sequence" name="all" _uid="1">
      <Action ID="setCameraAngles" name="left" pan="{=}" deadline_s="10"/>
      <SubTree ID="Shoot" _autoremap="true"/>
    </Control>
  </BehaviorTree>
  <BehaviorTree ID="Shoot">
    <Decorator ID="Timeout" msec="{wait}"><takePicture/></Decorator>
  </BehaviorTree>
  <!-- Groot2 writes what it knows of nodes -->
  <TreeNodesModel>
    <Action ID="setCameraAngles"><input_port name="pan" type="double"/></Action>
  </TreeNodesModel>
</root>"""
    requested = replace(
        plan("", pan="0.5", wait="9000"),
        content=groot.replace('format="4"', 'format="4" main_tree_to_execute="Look"').encode(),
    )
    root = check_plan(requested, SETTINGS)
    assert not isinstance(root, Refusal), root
    assert [step.location.path for step in steps(root)] == [
        "plan:survey/all/left",
        "plan:survey/all/Shoot/Timeout/takePicture",
    ]


def of_groot(body: str, root: str = 'BTCPP_format="4"', prolog: str = "") -> PlanDefinition:
    """Return a plan as Groot2 saves it: without main_tree_to_execute, with marks of its own."""
    return replace(plan(""), content=f"{prolog}<root {root}>{body}</root>".encode())


def distances(definition: PlanDefinition) -> list[float]:
    """Return how far each step of a plan drives."""
    root = check_plan(definition, SETTINGS)
    assert not isinstance(root, Refusal), root
    requests = [step.request for step in steps(root)]
    return [each.distance_m for each in requests if isinstance(each, MoveForward)]


LEG = '<BehaviorTree ID="Leg"><moveForward distance="{d}" deadline_s="30"/></BehaviorTree>'
MAIN = '<BehaviorTree ID="Main"><Sequence><SubTree ID="Leg" d="0.5"/></Sequence></BehaviorTree>'
DEFAULTS = """<TreeNodesModel>
  <SubTree ID="Leg"><input_port name="d" default="2" type="double">how far</input_port></SubTree>
  <Action ID="moveForward"><input_port name="distance" default="9"/><input_port/></Action>
</TreeNodesModel>"""


@pytest.mark.parametrize("trees", [MAIN + LEG, LEG + MAIN, f"{LEG}{MAIN}<TreeNodesModel/>"])
def test_the_tree_that_no_other_names_is_run(trees: str) -> None:
    assert distances(of_groot(trees)) == [0.5]


@pytest.mark.parametrize("more", [MAIN.replace("Main", "Other"), MAIN.replace("Main", "A/B")])
def test_of_two_trees_that_no_other_names_neither_is_run(more: str) -> None:
    found = refusal(of_groot(MAIN + LEG + more))
    assert found.reason is Reason.PLAN_STRUCTURE
    assert "main_tree_to_execute must name the tree to run" in found.text


def test_trees_that_name_each_other_have_no_first() -> None:
    trees = MAIN + MAIN.replace("Leg", "Main").replace("Main", "Leg", 1)
    assert "main_tree_to_execute must name" in refusal(of_groot(trees)).text


@pytest.mark.parametrize(
    ("values", "driven"),
    [("", [2.0]), ('d="0.5"', [0.5]), ('_autoremap="false"', [2.0]), ('d="{x}"', [0.25])],
)
def test_a_subtree_has_the_defaults_of_its_model(values: str, driven: list[float]) -> None:
    trees = MAIN.replace('d="0.5"', values) + LEG + DEFAULTS
    arguments = (PlanArgument("x", "0.25"),) if "{x}" in values else ()
    assert distances(replace(of_groot(trees), arguments=arguments)) == driven


def test_a_default_of_a_model_may_be_an_argument() -> None:
    trees = MAIN.replace('d="0.5"', "") + LEG + DEFAULTS.replace('"2"', '"{x}"')
    given = replace(of_groot(trees), arguments=(PlanArgument("x", "0.25"),))
    assert distances(given) == [0.25]
    assert "{x}" in refusal(of_groot(trees)).text


def test_with_autoremap_outer_arguments_count_and_no_default() -> None:
    trees = MAIN.replace('d="0.5"', '_autoremap="1"') + LEG + DEFAULTS
    given = replace(of_groot(trees), arguments=(PlanArgument("d", "0.25"),))
    assert distances(given) == [0.25]
    assert "{d}" in refusal(of_groot(trees)).text


MARKS = '_collapsed="true" _fullpath="Leg::1" _uid="7" _description="far" _favorite="x"'


def test_editor_notes_are_no_script() -> None:
    leg = LEG.replace('distance="{d}"', f'distance="{{d}}" {MARKS}')
    trees = MAIN.replace('d="0.5"', f'd="0.5" {MARKS}').replace("<Sequence", f"<Sequence {MARKS}")
    assert distances(of_groot(trees + leg)) == [0.5]


SCRIPTS = ("_skipIf", "_failureIf", "_successIf", "_while", "_onSuccess", "_onFailure", "_onHalted")


@pytest.mark.parametrize("script", [*SCRIPTS, "_post"])
def test_conditions_and_scripts_are_read_with_their_column(script: str) -> None:
    for where in ('<SubTree ID="Leg"', "<Sequence", "<moveForward"):
        trees = (MAIN + LEG).replace(where, f'{where} {script}="1 == x"')
        assert f"{script}: column 6: nothing sets x" in refusal(of_groot(trees)).text
        assert distances(of_groot(trees.replace("== x", "== 2"))) in ([0.5], [])


@pytest.mark.parametrize("attribute", ["_skipif", "_autoremap", "_later", "_"])
def test_an_unknown_attribute_with_an_underscore_is_refused(attribute: str) -> None:
    trees = (MAIN + LEG).replace("<moveForward", f'<moveForward {attribute}="1"')
    assert f"attribute '{attribute}' is neither a condition" in refusal(of_groot(trees)).text


LATIN = '<?xml version="1.0" encoding="ISO-8859-1"?>'
NAMED = MAIN.replace('<SubTree ID="Leg" d="0.5"/>', GO.replace("/", ' name="Gelände"/'))


@pytest.mark.parametrize(
    ("prolog", "encoding"),
    [
        (LATIN, "iso-8859-1"),
        (LATIN, "utf-8"),
        ("", "utf-8"),
        ('<?xml version="1.0" encoding="windows-1252"?>', "cp1252"),
        ('<?xml version="1.0" encoding="UTF-16"?>', "utf-16"),
    ],
)
def test_a_text_is_read_as_it_declares_or_as_utf_8(prolog: str, encoding: str) -> None:
    content = of_groot(NAMED, prolog=prolog).content.decode().encode(encoding)
    root = check_plan(replace(plan(""), content=content), SETTINGS)
    assert not isinstance(root, Refusal), root
    assert [step.location.path for step in steps(root)] == ["plan:survey/Sequence/Gelände"]


@pytest.mark.parametrize("declared", ["", "utf-8", "none", "utf-7", "zlib_codec", "shift_jis"])
def test_a_text_that_is_not_as_it_declares_is_no_xml(declared: str) -> None:
    prolog = f'<?xml version="1.0" encoding="{declared}"?>' if declared else ""
    content = of_groot(NAMED, prolog=prolog).content.decode().encode("iso-8859-1")
    found = refusal(replace(plan(""), content=content))
    assert (found.reason, found.text[:19]) == (Reason.PLAN_NOT_XML, "line 1: invalid XML")


def test_siblings_of_one_name_have_paths_of_their_own() -> None:
    root = check_plan(plan(f"<Sequence>{GO}{GO}</Sequence>"), SETTINGS)
    assert not isinstance(root, Refusal)
    assert len({step.location.path for step in steps(root)}) == 2


@given(st.binary(max_size=400))
def test_every_input_is_refused_or_accepted(content: bytes) -> None:
    assert isinstance(check_plan(replace(plan(GO), content=content), SETTINGS), Refusal)


WHOLE = xml(
    '<Sequence><Timeout msec="900"><moveTo x="1" y="{y}"/></Timeout><Parallel success_count="-1">'
    f'{GO}<SubTree ID="Two" a="&#x41;"/></Parallel></Sequence>',
    f'<BehaviorTree ID="Two"><Repeat num_cycles="2">{GO}</Repeat></BehaviorTree>',
)


@given(st.data())
def test_a_mutated_plan_is_refused_or_taken(data: st.DataObject) -> None:
    octets = bytearray(WHOLE)
    for _ in range(data.draw(st.integers(1, 6))):
        at = data.draw(st.integers(0, len(octets) - 1))
        match data.draw(st.sampled_from(["set", "cut", "copy"])):
            case "set":
                octets[at] = data.draw(st.integers(0, 255))
            case "cut":
                del octets[at : at + data.draw(st.integers(1, 30))]
            case _:
                octets[at:at] = octets[at : at + data.draw(st.integers(1, 60))]
        if not octets:
            break
    requested = replace(plan(GO, y="2"), content=bytes(octets))
    found = check_plan(requested, SETTINGS)
    assert not isinstance(found, Refusal) or found.text
