"""The checks before uplink: flawed plans with the line of their fault, and sound plans without."""

from pathlib import Path
from time import process_time

import pytest

from executive.commands import PlanDefinition
from executive.plans import FORMAT, Finding, Level, PlanRoot, find_faults, read_plan
from executive.values.reasons import Refusal
from trees.plan import prove

MISSIONS = sorted((Path(__file__).parents[3] / "config/plans/missions").glob("*.xml"))

HERE = "<!-- here -->"
"""Marks the line of the fault."""


def definition(body: str, *trees: str, name: str = "tried") -> PlanDefinition:
    """Return a plan with a main tree and others."""
    more = "\n".join(trees)
    text = (
        '<root BTCPP_format="4" main_tree_to_execute="Main">\n'
        f'<BehaviorTree ID="Main">\n{body}\n</BehaviorTree>\n{more}\n</root>'
    )
    return PlanDefinition(name, name, FORMAT, text.encode())


def read(plan: PlanDefinition) -> PlanRoot:
    """Return a plan as it was read."""
    root = read_plan(plan)
    assert not isinstance(root, Refusal), root.text
    return root


def faults(plan: PlanDefinition, begin_utc_s: float | None = None) -> list[Finding]:
    """Return what both checks find, without notes."""
    root = read(plan)
    found = [*find_faults(root, begin_utc_s), *prove(root).findings]
    return [each for each in found if each.level is not Level.NOTE]


def line_of(plan: PlanDefinition) -> int:
    """Return the marked line."""
    lines = plan.content.decode().splitlines()
    (marked,) = (number for number, line in enumerate(lines, 1) if HERE in line)
    return marked


DRIVE = '<moveTo name="drive" x="3" y="0" deadline_s="60"/>'
HOME = '<moveTo name="home" x="0" y="0" deadline_s="60"/>'
PICTURE = '<takePicture deadline_s="20"/>'
NOON, ONE = "2027-03-01T12:00:00Z", "2027-03-01T13:00:00Z"

FLAWED = {
    "a command before the last child of a ReactiveSequence": f"""<ReactiveSequence> {HERE}
        <takePicture deadline_s="20"/>
        {DRIVE}
        </ReactiveSequence>""",
    "a command behind a condition in a ReactiveSequence": f"""<ReactiveSequence> {HERE}
        <Sequence><ScriptCondition code="@LINK_UP == 1"/>
        <setTravelSpeed speed="0.1" deadline_s="5"/></Sequence>
        {DRIVE}
        </ReactiveSequence>""",
    "a Sleep before the last child of a ReactiveFallback": f"""<ReactiveFallback> {HERE}
        <Inverter><Sleep msec="5000"/></Inverter>
        {DRIVE}
        </ReactiveFallback>""",
    "RunOnce below Repeat": f"""<Repeat num_cycles="3"> {HERE}
        <RunOnce>{DRIVE}</RunOnce>
        </Repeat>""",
    "RunOnce in a loop over positions": f"""<LoopPlace queue="1,0;2,0" x="{{x}}" y="{{y}}"> {HERE}
        <RunOnce><moveTo x="{{x}}" y="{{y}}" deadline_s="60"/></RunOnce>
        </LoopPlace>""",
    "Parallel waits for a skipped child": f"""<Sequence>
        <Parallel success_count="2" failure_count="1"> {HERE}
        {DRIVE}
        <takePicture deadline_s="20" _skipIf="@BATERY_VOLTAGE &lt; 22"/>
        </Parallel></Sequence>""",
    "a case that is no option": f"""<Sequence>
        <Ask question="Go?" options="left;right" default="left" deadline_s="60" answer="{{path}}"/>
        <Switch2 variable="{{path}}" case_1="left" case_2="rigth"> {HERE}
        {DRIVE}{HOME}{PICTURE}
        </Switch2></Sequence>""",
    "options without a case": f"""<Sequence>
        <Ask question="?" options="a;b;c;d" default="a" deadline_s="60" answer="{{path}}"/>
        <Switch2 variable="{{path}}" case_1="a" case_2="b"> {HERE}
        {DRIVE}{HOME}{PICTURE}
        </Switch2></Sequence>""",
    "a comparison with no option": f"""<Sequence>
        <Ask question="?" options="yes;no" default="no" deadline_s="60" answer="{{good}}"/>
        <Precondition if="good == 'ja'" else="SUCCESS"> {HERE}
        {DRIVE}
        </Precondition></Sequence>""",
    "an answer that nothing reads": f"""<Sequence>
        <Ask question="?" options="a;b" default="a" deadline_s="60" answer="{{path}}"/> {HERE}
        {DRIVE}</Sequence>""",
    "a window after its end": f"""<Sequence>
        <WaitUntil utc="{ONE}"/>
        <Window until="{NOON}"> {HERE}
        {DRIVE}
        </Window></Sequence>""",
    "a window missed in the worst case": f"""<Sequence>
        <WaitUntil utc="{NOON}"/>
        <moveTo x="3" y="0" deadline_s="4000"/>
        <Window until="{ONE}"> {HERE}
        {PICTURE}
        </Window></Sequence>""",
    "a window too short for its steps": f"""<Window from="{NOON}" until="{ONE}"> {HERE}
        <Repeat num_cycles="3"><Sequence>
        {PICTURE}
        <Sleep msec="1500000"/></Sequence></Repeat>
        </Window>""",
    "a wait that is always too late": f"""<Sequence>
        <WaitUntil utc="{NOON}"/>
        <Sleep msec="3600000"/>
        <WaitUntil utc="{NOON}" late_s="600"/> {HERE}
        {PICTURE}</Sequence>""",
    "a wait until after its window": f"""<Window until="{NOON}"><Sequence>
        <WaitUntil utc="{ONE}"/> {HERE}
        {PICTURE}</Sequence></Window>""",
    "a question that outlasts its window": f"""<Window from="{NOON}" until="{ONE}"><Sequence>
        <Ask question="?" options="a;b" default="a" deadline_s="7200" answer="{{path}}"/> {HERE}
        <Switch2 variable="{{path}}" case_1="a" case_2="b">{DRIVE}{HOME}{PICTURE}</Switch2>
        </Sequence></Window>""",
    "a window in a loop": f"""<Repeat num_cycles="3"><Sequence>
        <Window from="{NOON}" until="{ONE}"> {HERE}
        {PICTURE}</Window>
        <Sleep msec="3600000"/></Sequence></Repeat>""",
    "a time in a loop that is late in the second cycle": f"""<Repeat num_cycles="2"><Sequence>
        <WaitUntil utc="{NOON}" late_s="60"/> {HERE}
        {PICTURE}<Sleep msec="600000"/></Sequence></Repeat>""",
    "milliseconds for the seconds of a deadline": f"""<Sequence>
        <moveTo x="3" y="0" deadline_s="60000"/> {HERE}
        {HOME}</Sequence>""",
    "a timeout shorter than its sleep": f"""<Fallback>
        <Timeout msec="60000"> {HERE}
        <Sequence>{PICTURE}<Sleep msec="90000"/></Sequence>
        </Timeout>
        {HOME}</Fallback>""",
    "seconds for milliseconds": f"""<Timeout msec="300"> {HERE}
        <moveTo x="3" y="0"/>
        </Timeout>""",
    "seconds for the milliseconds of a wait": f"""<Sequence>
        <Sleep msec="90"/> {HERE}
        {PICTURE}</Sequence>""",
    "a script that telemetry may leave undone": f"""<Sequence>
        <ForceSuccess><ScriptCondition code="volts := @BATERY_VOLTAGE; volts &gt; 24"/>
        </ForceSuccess>
        <ForceSuccess><ScriptCondition code="volts &gt; 25"/></ForceSuccess> {HERE}
        {DRIVE}</Sequence>""",
    "attempts that are made at once": f"""<Sequence>
        <RetryUntilSuccessful num_attempts="5"> {HERE}
        <ScriptCondition code="@BATERY_VOLTAGE &gt; 24"/>
        </RetryUntilSuccessful>
        {DRIVE}</Sequence>""",
    "a measured value is compared with ==": f"""<Sequence>
        <ScriptCondition code="@HEAD == 3.14"/> {HERE}
        {DRIVE}</Sequence>""",
    "to and fro": f"""<WhileDoElse> {HERE}
        <ScriptCondition code="@LINK_UP == 1"/>
        {DRIVE}
        <Sequence>{HOME}<WaitFor if="@LINK_UP == 1" deadline_s="60"/></Sequence>
        </WhileDoElse>""",
    "a wait for a variable that nothing sets": f"""<Fallback><Sequence>
        <Script code="ready := 0"/>
        <Fallback>{DRIVE}<Script code="ready := 1"/></Fallback>
        <ScriptCondition code="ready == 0"/>
        <WaitFor if="ready == 1" deadline_s="60"/> {HERE}
        </Sequence>
        {HOME}</Fallback>""",
    "a Parallel that the prover sees wait": f"""<Sequence>
        <Script code="lamp := 0"/>
        {DRIVE}
        <Parallel success_count="2" failure_count="1"> {HERE}
        <takePicture deadline_s="20"/>
        <Fallback><Sequence _skipIf="lamp == 0">{PICTURE}</Sequence></Fallback>
        </Parallel></Sequence>""",
    "a plan that cannot succeed": f"""<Sequence> {HERE}
        {DRIVE}
        <ForceFailure><takePicture deadline_s="20"/></ForceFailure>
        </Sequence>""",
    "a step behind a Fallback's success": f"""<Sequence>
        <Fallback>
        <ForceSuccess>{DRIVE}</ForceSuccess>
        <takePicture name="never" deadline_s="20"/> {HERE}
        </Fallback></Sequence>""",
    "a variable that a failed step does not set": f"""<Sequence>
        <ForceSuccess><takePicture deadline_s="20" _onSuccess="seen := 1"/></ForceSuccess>
        <ForceSuccess><ScriptCondition code="seen == 1"/></ForceSuccess> {HERE}
        {DRIVE}</Sequence>""",
    "an answer that may not exist": f"""<Sequence>
        <ForceSuccess>
        <Ask question="?" options="a;b" deadline_s="60" answer="{{path}}"/>
        </ForceSuccess>
        <Switch2 variable="{{path}}" case_1="a" case_2="b"> {HERE}
        {DRIVE}{HOME}{PICTURE}
        </Switch2></Sequence>""",
    "a branch that another arm changes": f"""<Sequence><Script code="part := 'a'"/>
        <Parallel><Repeat num_cycles="4"><Sequence><Sleep msec="5000"/>
        <Script code="part = @LINK_UP &gt; 0 ? 'a' : 'b'"/></Sequence></Repeat>
        <Switch2 variable="{{part}}" case_1="a" case_2="c"> {HERE}
        <moveForward distance="1" deadline_s="60"/>
        {HOME}{PICTURE}</Switch2></Parallel></Sequence>""",
    "steps that a guard does again": f"""<Timeout msec="900000"><ReactiveSequence>
        <Fallback><ScriptCondition code="@BATERY_VOLTAGE &gt; 23"/>
        <WaitFor if="@BATERY_VOLTAGE &gt; 25" deadline_s="60"/></Fallback>
        <Sequence>
        <moveForward distance="1" deadline_s="60"/> {HERE}
        <Sleep msec="60000"/></Sequence></ReactiveSequence></Timeout>""",
    "a division by a variable that can be 0": f"""<Sequence>
        <Script code="good := 0; tries := 0"/>
        <ForceSuccess><takePicture deadline_s="20" _onSuccess="good = 1; tries = 1"/></ForceSuccess>
        <ScriptCondition code="good / tries &gt; 0.5"/> {HERE}
        {DRIVE}</Sequence>""",
    "a wait for values that exclude each other": f"""<Fallback>
        <WaitFor if="24.5 &lt; @BATERY_VOLTAGE &lt; 20" deadline_s="9"/> {HERE}
        {DRIVE}</Fallback>""",
    "a charge in percent": f"""<ReactiveSequence>
        <ScriptCondition code="@BATTERY_CHARGE &gt; 30"/> {HERE}
        {DRIVE}</ReactiveSequence>""",
    "a heading in degrees": f"""<Fallback>
        <Sequence><ScriptCondition code="-90 &lt; @HEAD &lt; 90"/> {HERE}
        {DRIVE}</Sequence>{HOME}</Fallback>""",
    "a link that is neither up nor down": f"""<Sequence>
        <takePicture deadline_s="20" _skipIf="@LINK_UP == 2"/> {HERE}
        {DRIVE}</Sequence>""",
    "seconds for the milliseconds of a limit around rounds": f"""<Sequence><ForceSuccess>
        <Timeout msec="7200"> {HERE}
        <KeepRunningUntilFailure><Sequence>{DRIVE}{PICTURE}</Sequence></KeepRunningUntilFailure>
        </Timeout></ForceSuccess>{HOME}</Sequence>""",
    "a condition that assigns": f"""<Sequence><Script code="tries := 1"/>
        <ScriptCondition code="tries = 2"/> {HERE}
        {DRIVE}<ScriptCondition code="tries == 2"/></Sequence>""",
    "a case that another one has": f"""<Sequence><Script code="part := 0"/>
        <Parallel><Script code="part = @ENERGY_USED"/><Sleep msec="60000"/></Parallel>
        <Switch2 variable="{{part}}" case_1="1" case_2="1"> {HERE}
        {DRIVE}{HOME}{PICTURE}</Switch2></Sequence>""",
    "a text as the case of a number": f"""<Sequence><Script code="got := 0"/>
        <Repeat num_cycles="3"><takePicture deadline_s="9" _onSuccess="got += 1"/></Repeat>
        <Switch2 variable="{{got}}" case_1="none" case_2="3"> {HERE}
        {DRIVE}{HOME}{PICTURE}</Switch2></Sequence>""",
    "a node that is always skipped, on the line of the one above": f"""<Sequence>
        <Script code="wanted := 0"/>
        <Sequence><Sequence _skipIf="wanted == 0">{PICTURE}</Sequence>{DRIVE}</Sequence> {HERE}
        </Sequence>""",
    "attempts that drive further each time": f"""<RetryUntilSuccessful num_attempts="3"> {HERE}
        <Sequence><moveForward distance="1" deadline_s="30"/>{PICTURE}</Sequence>
        </RetryUntilSuccessful>""",
}


SOUND = {
    "the mode is a case by its word": f"""<Timeout msec="900000"><Switch2 variable="{{@MODE}}"
        case_1="IDLE" case_2="PLAN">{DRIVE}{HOME}{PICTURE}</Switch2></Timeout>""",
    "a guard, and what to do below it": f"""<Fallback>
        <ReactiveSequence><ScriptCondition code="@BATERY_VOLTAGE &gt; 22"/>
        <Sequence>{DRIVE}{PICTURE}</Sequence></ReactiveSequence>
        {HOME}</Fallback>""",
    "a setting once, beside a guard": f"""<ReactiveSequence>
        <RunOnce><setTravelSpeed speed="0.1" deadline_s="5"/></RunOnce>
        <ScriptCondition code="@LINK_SILENT_S &lt; 600"/>
        {DRIVE}</ReactiveSequence>""",
    "short waits": f"""<Sequence><Sleep msec="500"/><Delay delay_msec="200">{DRIVE}</Delay>
        </Sequence>""",
    "an assignment before one that telemetry may leave undone": f"""<Sequence>
        <ForceSuccess><ScriptCondition code="good := 1; volts := @BATERY_VOLTAGE; volts &gt; 24"/>
        </ForceSuccess>
        <ForceSuccess><ScriptCondition code="good == 1"/></ForceSuccess>{DRIVE}</Sequence>""",
    "a RunOnce beside other steps in a loop": f"""<Repeat num_cycles="3"><Sequence>
        <RunOnce>{DRIVE}</RunOnce>{PICTURE}</Sequence></Repeat>""",
    "a Parallel that does not wait for skipped children": f"""<Parallel>
        {DRIVE}<takePicture deadline_s="20" _skipIf="@BATERY_VOLTAGE &lt; 22"/></Parallel>""",
    "every option has a case": f"""<Sequence>
        <Ask question="?" options="a;b" default="a" deadline_s="60" answer="{{path}}"/>
        <Switch2 variable="{{path}}" case_1="a" case_2="b">{DRIVE}{HOME}<AlwaysFailure/></Switch2>
        </Sequence>""",
    "a question without default, and what to do then": f"""<Fallback><Sequence>
        <Ask question="?" options="a;b" deadline_s="60" answer="{{path}}"/>
        <Switch2 variable="{{path}}" case_1="a" case_2="b">{DRIVE}{HOME}{PICTURE}</Switch2>
        </Sequence>{PICTURE}</Fallback>""",
    "windows one after the other": f"""<Sequence>
        <ForceSuccess><Window from="{NOON}" until="{ONE}">{DRIVE}</Window></ForceSuccess>
        <ForceSuccess><Window from="{ONE}" until="2027-03-01T14:00:00Z">{PICTURE}</Window>
        </ForceSuccess>{HOME}</Sequence>""",
    "a count of a long loop decides": f"""<Sequence><Script code="good := 0"/>
        <Repeat num_cycles="10">
        <ForceSuccess><takePicture deadline_s="20" _onSuccess="good += 1"/></ForceSuccess>
        </Repeat><ScriptCondition code="good &gt;= 8"/>{HOME}</Sequence>""",
    "the value of a loop decides": f"""<LoopString queue="a;b;c;d" value="{{part}}">
        <Switch3 variable="{{part}}" case_1="a" case_2="b" case_3="c">
        {DRIVE}{HOME}{PICTURE}<rotateTo heading="0" deadline_s="30"/></Switch3></LoopString>""",
    "the reason of a refusal decides": f"""<Fallback>
        <moveTo x="3" y="0" deadline_s="60" reason="{{why}}"/>
        <Sequence><ScriptCondition code="why == 214"/>{PICTURE}</Sequence>
        {HOME}</Fallback>""",
    "a wait for the other arm": f"""<Sequence><Script code="there := 0"/><Parallel>
        <moveTo x="3" y="0" deadline_s="60" _onSuccess="there = 1"/>
        <Sequence><WaitFor if="there == 1" deadline_s="60"/>{PICTURE}</Sequence>
        </Parallel></Sequence>""",
    "rounds below a Timeout": f"""<ForceSuccess><Timeout msec="3600000">
        <KeepRunningUntilFailure><Sequence>{DRIVE}{HOME}</Sequence></KeepRunningUntilFailure>
        </Timeout></ForceSuccess>""",
    "rounds that count": f"""<Sequence><Script code="rounds := 0"/>
        <ForceSuccess><Timeout msec="3600000"><KeepRunningUntilFailure>
        <Sequence _onSuccess="rounds += 1">{DRIVE}{HOME}</Sequence>
        </KeepRunningUntilFailure></Timeout></ForceSuccess>
        <ScriptCondition code="rounds &gt; 40"/>{PICTURE}</Sequence>""",
    "not before a time": f"""<ReactiveSequence><WaitUntil utc="{NOON}"/>
        {DRIVE}</ReactiveSequence>""",
    "a stored voltage": f"""<Sequence><Script code="before := @BATERY_VOLTAGE"/>{DRIVE}
        <ScriptCondition code="before - @BATERY_VOLTAGE &lt; 1"/>{HOME}</Sequence>""",
    "a subtree that its port decides": """<Sequence><SubTree ID="Go" mode="a"/>
        <SubTree ID="Go" mode="b"/></Sequence></BehaviorTree><BehaviorTree ID="Go"><Fallback>
        <Sequence><ScriptCondition code="mode == 'a'"/><takePicture deadline_s="20"/></Sequence>
        <rotateTo heading="0" deadline_s="30"/></Fallback>""",
    "three things at once": f"""<Parallel>{DRIVE}{PICTURE}
        <setCameraAngles pan="0" tilt="0" deadline_s="9"/></Parallel>""",
    "memory over failures": f"""<RetryUntilSuccessful num_attempts="2"><SequenceWithMemory>
        {DRIVE}{PICTURE}{HOME}</SequenceWithMemory></RetryUntilSuccessful>""",
    "cleaned up": f"""<TryCatch>{DRIVE}{PICTURE}{HOME}</TryCatch>""",
    "a battery that reports, and a chained comparison": f"""<Fallback><Sequence>
        <WaitFor if="@BATERY_VOLTAGE &gt; 0" deadline_s="60"/>
        <ScriptCondition code="24 &lt; @BATERY_VOLTAGE &lt; 29 || @LINK_UP == 1"/>
        <ScriptCondition code="@HEAD &lt; 1.57 &amp;&amp; !(@BATTERY_CHARGE &lt; 0.3)"/>
        {DRIVE}</Sequence>{HOME}</Fallback>""",
    "a short limit around a short step": f"""<Fallback>
        <Timeout msec="8000"><setCameraAngles pan="0" tilt="0" deadline_s="8"/></Timeout>
        {DRIVE}</Fallback>""",
    "a relative step that is tried again alone": f"""<Sequence>
        <RetryUntilSuccessful num_attempts="2"><rotateBy angle="0.5" deadline_s="30"/>
        </RetryUntilSuccessful>{PICTURE}</Sequence>""",
    "a branch by a stored time of day": f"""<Sequence>
        <Script code="part := @UTC &lt; 1800010000 ? 'morning' : 'noon'"/>
        <Switch2 variable="{{part}}" case_1="morning" case_2="noon">{DRIVE}{HOME}{PICTURE}</Switch2>
        </Sequence>""",
    "settings that a guard does again": f"""<Timeout msec="900000"><WhileDoElse>
        <ScriptCondition code="@LINK_UP == 1"/>
        <Sequence><setCameraAngles pan="1" tilt="0" deadline_s="9"/>{PICTURE}</Sequence>
        <Sequence><setCameraAngles pan="0" tilt="0" deadline_s="9"/>
        <WaitFor if="@LINK_UP == 1" deadline_s="60"/></Sequence>
        </WhileDoElse></Timeout>""",
    "attempts in a window": f"""<Window from="{NOON}" until="{ONE}">
        <RetryUntilSuccessful num_attempts="3"><Sequence>
        <Ask question="?" options="a;b" default="a" deadline_s="600" answer="{{path}}"/>
        <Switch2 variable="{{path}}" case_1="a" case_2="b">{DRIVE}{HOME}{PICTURE}</Switch2>
        </Sequence></RetryUntilSuccessful></Window>""",
    "a begin that the first round waits for": f"""<Repeat num_cycles="3"><Sequence>
        <WaitUntil utc="{NOON}"/>{PICTURE}<Sleep msec="600000"/></Sequence></Repeat>""",
    "inverted": f"""<Sequence><Inverter><FaultActive name="battery_low"/></Inverter>
        <Delay delay_msec="5000">{DRIVE}</Delay></Sequence>""",
}


@pytest.mark.parametrize("name", SOUND)
def test_a_sound_plan_has_no_finding(name: str) -> None:
    assert faults(definition(SOUND[name])) == []


@pytest.mark.parametrize("name", FLAWED)
def test_a_flawed_plan_has_its_fault_at_its_line(name: str) -> None:
    plan = definition(FLAWED[name])
    found = faults(plan)
    assert line_of(plan) in {each.line for each in found}, found


def test_the_remedy_for_a_misspelt_telemetry_is_its_name() -> None:
    for script in ("@BATTERY_VOLTAGE &gt; 22", "BATTERY_VOLTAGE &gt; 22"):
        refusal = read_plan(definition(f"<Sequence><ScriptCondition code='{script}'/></Sequence>"))
        assert isinstance(refusal, Refusal)
        assert refusal.text.endswith(": did you mean @BATERY_VOLTAGE?")


def test_the_remedy_for_a_plan_that_ends_skipped_is_a_success_after_it() -> None:
    can_skip = f'<ForceSuccess _skipIf="@LINK_UP == 1">{PICTURE}</ForceSuccess>'
    (found,) = faults(definition(can_skip))
    assert "put it into a Sequence, with an AlwaysSuccess after it" in found.text
    assert faults(definition(f"<Sequence>{can_skip}<AlwaysSuccess/></Sequence>")) == []


def test_a_misspelt_fault_has_one_remedy() -> None:
    refusal = read_plan(definition('<FaultActive name="batery_low"/>'))
    assert isinstance(refusal, Refusal)
    assert refusal.text == "line 3: name 'batery_low': did you mean battery_low?"


def test_rounds_are_counted_once_with_a_note() -> None:
    (note,) = find_faults(read(definition(SOUND["rounds below a Timeout"])))
    assert (note.level, note.line) == (Level.NOTE, 4)
    assert note.text == "time limits it: the maximum number of commands has one round of it"


def test_trees_and_ports_that_nothing_uses_are_named() -> None:
    go = f'<BehaviorTree ID="Go">{DRIVE}</BehaviorTree>'
    plan = definition(
        '<SubTree ID="Go" xx="1"/>', go, f'<BehaviorTree ID="No">{HOME}</BehaviorTree>'
    )
    found = {each.line: each.text for each in faults(plan)}
    assert found == {
        3: "the tree Go does not read xx: remove it",
        6: "nothing runs the tree No: remove it, or run it by a SubTree",
    }


def test_the_remedy_for_the_file_of_a_failed_picture_is_a_variable_of_its_own() -> None:
    plan = definition(f"""<Sequence><Script code="file := ''"/>
        <ForceSuccess><takePicture deadline_s="20" file="{{file}}"/></ForceSuccess>
        <ForceSuccess><ScriptCondition code="file != ''"/></ForceSuccess> {HERE}
        {DRIVE}</Sequence>""")
    (found,) = faults(plan)
    assert (found.line, found.text) == (
        line_of(plan),
        "file is not known after its step failed: note its success in another variable by"
        " _onSuccess",
    )


def test_an_exploration_that_is_cut_short_is_not_a_proof() -> None:
    arm = "<Sequence>" + PICTURE * 6 + "</Sequence>"
    plan = read(definition(f"<Parallel>{arm * 3}</Parallel>"))
    proof = prove(plan, max_work=10_000)
    assert proof.verdict == "no fault found"
    assert "states were not explored" in proof.limits[0]
    conditions = "".join(f"<ScriptCondition code='@HEAD &gt; {i}'/>" for i in range(9))
    first = f"<Sequence>{PICTURE}<ParallelAll>{conditions}</ParallelAll></Sequence>"
    assert prove(read(definition(first)), max_work=6000).verdict == "no fault found"
    whole = prove(read(definition(f"<Parallel>{arm * 2}</Parallel>")))
    assert (whole.verdict, whole.limits) == ("proved", ())
    cycles = prove(read(definition(f'<Repeat num_cycles="9">{PICTURE}</Repeat>')))
    assert cycles.verdict == "no fault found"
    assert cycles.limits == ("line 3: Repeat explored with 2 of 9 cycles",)


LIMITED = {
    "a count of any value": (
        f"""<Sequence><Script code="rounds := 0"/>
        <ForceSuccess><Timeout msec="3600000"><KeepRunningUntilFailure>
        <Sequence _onSuccess="rounds += 1">{PICTURE}</Sequence>
        </KeepRunningUntilFailure></Timeout></ForceSuccess>
        <ScriptCondition code="rounds &gt; 40"/>{HOME}</Sequence>""",
        "rounds: explored with any value after 8",
    ),
    "a divisor that is measured": (
        f"""<Fallback><Sequence>
        <Script code="rate := 10 / @LINK_SILENT_S"/> {HERE}
        <ScriptCondition code="rate &gt; 1"/>{PICTURE}</Sequence>{HOME}</Fallback>""",
        "a divisor that is not constant",
    ),
    "a divisor that depends on a measured value": (
        f"""<Fallback><Sequence><Script code="n := @LINK_SILENT_S; x := 5"/>
        <Script code="x /= n"/> {HERE}
        <ScriptCondition code="x &gt; 1"/>{PICTURE}</Sequence>{HOME}</Fallback>""",
        "a divisor that is not constant",
    ),
    "bits of a measured value": (
        f"""<Fallback><Sequence>
        <ScriptCondition code="@BATERY_VOLTAGE &amp; 1"/> {HERE}
        {PICTURE}</Sequence>{HOME}</Fallback>""",
        "bits of a value that may have none",
    ),
    "a target from a variable": (
        f"""<LoopPlace queue="1,0;900000,0" x="{{x}}" y="{{y}}">
        <moveTo x="{{x}}" y="{{y}}" deadline_s="60"/> {HERE}
        </LoopPlace>""",
        "bounds of arguments from variables are checked aboard",
    ),
    "a queue that telemetry decides": (
        f"""<Fallback><Sequence><Script code="queue := 'a;' .. @HEAD"/>
        <LoopString queue="{{queue}}" value="{{part}}"> {HERE}
        <Sequence _skipIf="part == 'a'">{PICTURE}</Sequence>
        </LoopString></Sequence>{HOME}</Fallback>""",
        "its queue may be any",
    ),
}


@pytest.mark.parametrize("name", LIMITED)
def test_a_part_that_is_not_explored_exactly_is_a_limit(name: str) -> None:
    body, limit = LIMITED[name]
    plan = definition(body)
    proof = prove(read(plan))
    assert proof.findings == ()
    assert proof.verdict == "no fault found"
    line = f"line {line_of(plan)}: " if HERE in body else ""
    assert proof.limits == (line + limit,)


def test_a_division_that_is_explored_exactly_is_no_limit() -> None:
    body = f"""<Fallback><Sequence><Script code="n := 4; x := 5 / n; y := @HEAD / 2"/>
        <ScriptCondition code="x + y &gt; 1"/>{PICTURE}</Sequence>{HOME}</Fallback>"""
    proof = prove(read(definition(body)))
    assert (proof.verdict, proof.findings, proof.limits) == ("proved", (), ())


@pytest.mark.parametrize(
    "first",
    [
        f'<TryCatch><Sequence><ScriptCondition code="@LINK_UP == 1"/>{PICTURE}</Sequence>{HOME}'
        "</TryCatch>",
        f'<IfThenElse><ScriptCondition code="@LINK_UP == 1"/>{PICTURE}{HOME}</IfThenElse>',
        f'<ParallelAll><ScriptCondition code="@LINK_UP == 1"/>{PICTURE}</ParallelAll>',
    ],
)
def test_a_node_passes_at_once_only_if_its_steps_do(first: str) -> None:
    plan = definition(f"<ReactiveSequence> {HERE}\n{first}{DRIVE}</ReactiveSequence>")
    (found,) = (each for each in find_faults(read(plan)) if each.level is Level.ERROR)
    assert (found.line, "begins again in each tick" in found.text) == (line_of(plan), True)


def test_a_parallel_that_needs_one_of_two_may_pass_at_once() -> None:
    first = (
        f'<Parallel success_count="1"><ScriptCondition code="@LINK_UP == 1"/>{PICTURE}</Parallel>'
    )
    found = find_faults(read(definition(f"<ReactiveSequence>{first}{DRIVE}</ReactiveSequence>")))
    assert [each for each in found if each.level is Level.ERROR] == []


def test_a_port_is_read_by_its_name_and_not_by_a_node_of_this_name() -> None:
    go = f'<BehaviorTree ID="Go"><Sequence name="x">{DRIVE}</Sequence></BehaviorTree>'
    found = faults(definition('<SubTree ID="Go" x="1"/>', go))
    assert [each.text for each in found] == ["the tree Go does not read x: remove it"]


def test_a_wait_that_guards_in_each_tick_is_a_warning() -> None:
    plan = definition(f"""<Timeout msec="600000"><ReactiveSequence> {HERE}
        <WaitFor if="@BATERY_VOLTAGE &gt; 24" deadline_s="60"/>
        {DRIVE}</ReactiveSequence></Timeout>""")
    (found,) = (each for each in find_faults(read(plan)) if each.level is not Level.NOTE)
    assert (found.level, found.line) == (Level.WARNING, line_of(plan))
    assert found.text.startswith("WaitFor begins again in each tick, and halts")


def test_a_planned_begin_decides_which_windows_are_missed() -> None:
    plan = definition(f"""<Sequence>
        <moveTo x="3" y="0" deadline_s="600"/>
        <Window until="{NOON}">{PICTURE}</Window></Sequence>""")
    noon_s = 1_803_902_400.0
    levels = {
        noon_s - 700: [],
        noon_s - 500: [(Level.WARNING, "it is missed in the worst case, by 100 s")],
        noon_s + 60: [(Level.ERROR, "it is always missed, by 60 s at least")],
    }
    for begin_s, expected in levels.items():
        found = find_faults(read(plan), begin_s)
        assert [(each.level, each.text.partition(":")[0]) for each in found] == expected


def test_a_long_list_of_alternatives_is_explored_to_its_end() -> None:
    either = f"<Fallback><Sequence>{DRIVE}{PICTURE}</Sequence>{HOME}</Fallback>"
    proof = prove(read(definition(f"<Sequence>{either * 20}</Sequence>")))
    assert (proof.verdict, proof.states < 100) == ("proved", True)


def test_nested_loops_are_checked_in_time() -> None:
    loop, end = '<RetryUntilSuccessful num_attempts="2">', "</RetryUntilSuccessful>"
    plan = definition(f"{loop * 12}{PICTURE}{end * 12}")
    begin_s = process_time()
    assert find_faults(read(plan)) == ()
    assert process_time() - begin_s < 0.5


@pytest.mark.at_length
@pytest.mark.parametrize("mission", MISSIONS, ids=lambda path: path.stem)
def test_a_mission_is_without_a_fault(mission: Path) -> None:
    plan = PlanDefinition(mission.stem, mission.name, FORMAT, mission.read_bytes())
    root = read(plan)
    begin_s = process_time()
    found = find_faults(root)
    checked_s = process_time()
    proof = prove(root)
    assert [each for each in found if each.level is not Level.NOTE] == []
    assert proof.findings == ()
    assert checked_s - begin_s < 0.05
    assert process_time() - checked_s < 2.0
