"""The node kinds of plans: a table of names, roles, ports and children.

The reader's checks, the palette for Groot2, the console and the documentation derive from it. The
kinds of command leaves derive from the catalogue, the names of telemetry from the parameters.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import Enum, unique
from types import MappingProxyType
from typing import Final

from executive.commands import Argument, CommandDeclaration, Family, Waypoint, all_declarations
from executive.values.parameters import Parameter

DEADLINE: Final = "deadline_s"
"""The attribute that sets a leaf's deadline; required unless the time is limited above it."""

_STEERING: Final = {
    Family.PLAN,
    Family.PLAN_START,
    Family.STOP,
    Family.RESUME,
    Family.CONFIRMATION,
}
"""Commands that a plan may not give; only an operator may confirm the pose, after a check."""

LEAVES: Final = {
    declaration.name: declaration
    for declaration in all_declarations()
    if declaration.family not in _STEERING
}
"""The requests that can be a step of a plan, by the names of their leaves."""


@unique
class Role(Enum):
    """Role of a node in the tree, as named by BehaviorTree.CPP."""

    CONTROL = "Control"
    DECORATOR = "Decorator"
    ACTION = "Action"
    CONDITION = "Condition"
    SUBTREE = "SubTree"


@unique
class PortType(Enum):
    """Type of the value of a port.

    Attributes:
        COUNT, SECONDS, MILLISECONDS, UTC, STATUS, FLAG: known when the plan is read.
        NUMBER, TEXT, ANY: may be read from the blackboard.
        WRITTEN_NUMBER, WRITTEN_TEXT, WRITTEN: output ports.
        CONDITION, STATEMENTS: scripts.
    """

    COUNT = "count"
    SECONDS = "seconds"
    MILLISECONDS = "milliseconds"
    UTC = "utc"
    STATUS = "status"
    FLAG = "flag"
    NUMBER = "number"
    TEXT = "text"
    ANY = "any"
    CONDITION = "condition"
    STATEMENTS = "statements"
    WRITTEN_NUMBER = "written_number"
    WRITTEN_TEXT = "written_text"
    WRITTEN = "written"

    @property
    def is_output(self) -> bool:
        """Whether the node writes the port."""
        return self.value.startswith("written")

    @property
    def is_script(self) -> bool:
        """Whether the value is a script."""
        return self in {PortType.CONDITION, PortType.STATEMENTS}


@dataclass(frozen=True, slots=True)
class Port:
    """One port of a kind of node.

    Attributes:
        default: its text if it is omitted; None if it has none.
        optional: whether it may be omitted without a default.
        argument: the argument of the command that it sets, if any.
    """

    name: str
    type: PortType
    meaning: str
    default: str | None = None
    optional: bool = False
    argument: Argument | None = None

    @property
    def required(self) -> bool:
        """Whether it must be given."""
        return self.default is None and not self.optional


@dataclass(frozen=True, slots=True)
class NodeKind:
    """One kind of node.

    Attributes:
        min_children, max_children: bounds of its number of children; None for no maximum.
        command: the command that a leaf gives, if any.
        needs_limit: whether its deadline is required unless the time is limited above it.
    """

    name: str
    role: Role
    meaning: str
    ports: tuple[Port, ...] = ()
    min_children: int = 0
    max_children: int | None = 0
    command: CommandDeclaration | None = None
    needs_limit: bool = False

    def port(self, name: str) -> Port | None:
        """Return a port by its name."""
        return next((each for each in self.ports if each.name == name), None)


def attribute_help(argument: Argument) -> str:
    """Return the human-readable description of a leaf's attribute."""
    if argument.kind is Waypoint:
        return "x,y or x,y,heading (m, rad) joined by ;"
    return argument.meaning


_DEADLINE: Final = Port(
    DEADLINE,
    PortType.SECONDS,
    "timeout in s, then it fails; needed unless below a Timeout or a Window",
    optional=True,
)
QUESTION: Final = "Ask"
_TABLE: Final = f"""
control Sequence: runs its children in order, until one fails
control Fallback: runs its children in order, until one succeeds
control AsyncSequence: a Sequence that yields between children that end at once
control AsyncFallback: a Fallback that yields between children that end at once
control SequenceWithMemory: a Sequence that continues at the child that failed
control ReactiveSequence: ticks its children from the first one in each tick
control ReactiveFallback: ticks its children from the first one in each tick
control Parallel: runs all its children, until enough have succeeded or failed
  success_count count = -1: successes needed; -1 for all not skipped
  failure_count count = 1: failures that fail it
control ParallelAll: runs all its children to their ends
  max_failures count = 1: failures that fail it
control IfThenElse 2 3: tests its first child once, runs the second or third
control WhileDoElse 2 3: tests its first child each tick, runs the second or third
control TryCatch 2: a Sequence; after a failure its last child cleans up, then it fails
  catch_on_halt flag = false: whether to clean up when it is halted
decorator Inverter: exchanges success and failure
decorator ForceSuccess: succeeds after its child has ended
decorator ForceFailure: fails after its child has ended
decorator Repeat: runs its child again after a success
  num_cycles count: number of cycles; -1 below a limit of time only
decorator RetryUntilSuccessful: runs its child again after a failure
  num_attempts count: number of attempts; -1 below a limit of time only
decorator KeepRunningUntilFailure: runs its child again; below a limit of time only
decorator RunOnce: runs its child once in a plan
  then_skip flag = true: whether it is skipped later
decorator Timeout: fails if its child has not ended in time
  msec milliseconds: time limit in ms
decorator Delay: runs its child after a time
  delay_msec milliseconds: time before, in ms
decorator Precondition: runs its child if a condition holds when it begins
  if condition: the condition
  else status = FAILURE: result if it does not hold
decorator LoopString: runs its child for each part of a queue
  queue text: texts joined by ;
  value written_text: the part
  if_empty status = SUCCESS: result after the last part
decorator LoopDouble: runs its child for each number of a queue
  queue text: numbers joined by ;
  value written_number: the number
  if_empty status = SUCCESS: result after the last part
decorator LoopPlace: runs its child for each position of a queue
  queue text: x,y or x,y,heading (m, rad) joined by ;
  x written_number: m
  y written_number: m
  heading written_number ?: rad
  if_empty status = SUCCESS: result after the last part
decorator Window: runs its child between two times, and fails at the end
  from utc ?: time before which it waits, as 2026-11-27T09:00:00Z
  until utc ?: time when its child is halted
action Script: runs statements
  code statements: statements
condition ScriptCondition: succeeds if a condition holds
  code condition: the condition
action SetBlackboard: sets a variable
  value any: the value, or another variable
  output_key written: the variable
action AlwaysSuccess: succeeds
action AlwaysFailure: fails
action Sleep: waits
  msec milliseconds: time in ms
action WaitUntil: succeeds from a time on
  utc utc: the time, as 2026-11-27T09:00:00Z
  late_s seconds ?: delay in s after which it fails when it begins
action WaitFor: succeeds as soon as a condition holds
  if condition: the condition
  {DEADLINE} seconds ?: {_DEADLINE.meaning}
action {QUESTION}: requests one of several options from the operators
  question text: text of the question
  options text: options joined by ;
  default text ?: option at the deadline; without one it fails
  {DEADLINE} seconds ?: {_DEADLINE.meaning}
  answer written_text: the chosen option
condition Near: succeeds if the rover is near a position
  x number: m
  y number: m
  within seconds: distance in m
condition Reachable: succeeds if a moveTo would be accepted
  x number: m
  y number: m
condition FaultActive: succeeds while a fault is active
  name text: name of the fault
"""
"""The nodes: role, name, bounds of the number of children; a line for each port."""

_CHILDREN: Final = {Role.CONTROL: (1, None), Role.DECORATOR: (1, 1)}


def _switches() -> Iterator[NodeKind]:
    for cases in range(2, 7):
        ports = [Port("variable", PortType.ANY, "value that selects the child", optional=True)]
        for number in range(1, cases + 1):
            ports.append(Port(f"case_{number}", PortType.ANY, f"value of child {number}"))
        meaning = "runs the child with the case of the variable, else the last child"
        count = cases + 1
        yield NodeKind(f"Switch{cases}", Role.CONTROL, meaning, tuple(ports), count, count)


def _nodes(table: str) -> Iterator[NodeKind]:
    for entry in re.split(r"\n(?! )", table.strip()):
        head, *lines = entry.split("\n")
        signature, _, meaning = head.partition(": ")
        role_name, name, *bounds = signature.split()
        role, ports = Role(role_name.capitalize()), tuple(map(_port, lines))
        low, high = _CHILDREN.get(role, (0, 0))
        if bounds:
            low, high = int(bounds[0]), int(bounds[1]) if bounds[1:] else None
        limited = any(each.name == DEADLINE for each in ports)
        yield NodeKind(name, role, meaning, ports, low, high, needs_limit=limited)


def _port(line: str) -> Port:
    signature, _, meaning = line.partition(": ")
    name, kind, *rest = signature.split()
    default = rest[1] if rest[:1] == ["="] else None
    return Port(name, PortType[kind.upper()], meaning, default, optional=rest == ["?"])


def _command(declaration: CommandDeclaration) -> NodeKind:
    ports = [
        Port(
            each.name,
            PortType.NUMBER if each.kind is float else PortType.TEXT,
            attribute_help(each),
            optional=each.optional,
            argument=each,
        )
        for each in declaration.user_arguments
    ]
    ports += [_DEADLINE, _REASON, *_MORE_OUTPUTS.get(declaration.name, ())]
    return NodeKind(
        declaration.name,
        Role.ACTION,
        declaration.summary,
        tuple(ports),
        command=declaration,
        needs_limit=True,
    )


_REASON: Final = Port(
    "reason", PortType.WRITTEN_NUMBER, "number of the refusal; 0 after success", optional=True
)
_MORE_OUTPUTS: Final = {
    "takePicture": (
        Port("file", PortType.WRITTEN_TEXT, "path of the stored picture", optional=True),
    )
}

SUBTREE: Final = "SubTree"
ROOT_KIND: Final = NodeKind(SUBTREE, Role.SUBTREE, "runs another tree", (), 1, 1)
_KINDS: Final = (*_nodes(_TABLE), *_switches(), *map(_command, LEAVES.values()))
DIALECT: Final[Mapping[str, NodeKind]] = MappingProxyType({each.name: each for each in _KINDS})
"""The node kinds by name, without `SubTree`."""

_REMEDIES: Final = f"""
stop: a plan cannot stop the rover: an external stop suspends the plan
resume: a plan cannot resume the rover: mission control does, after a stop
ManualSelector: an editor is not connected aboard: use {QUESTION}
UnsetBlackboard WasEntryUpdated EntryUpdated SkipUnlessUpdated WaitValueUpdate WaitValueUpdated\
 ConsumeQueue PopFromQueue: queues and update counters are of one process: use WaitFor or LoopString
LoopInt LoopBool: use LoopDouble or LoopString
TestNode: a plan has no test doubles: use AlwaysSuccess, AlwaysFailure or Sleep
RecoveryNode: of Nav2: use RetryUntilSuccessful around a Fallback of the action and its recovery
RateController: of Nav2: use Repeat with a Delay, or a Sleep in a Sequence
PipelineSequence: of Nav2: use ReactiveSequence, or Parallel
RoundRobin: of Nav2: use Fallback or SequenceWithMemory
SequenceStar: an older name: use SequenceWithMemory
FallbackStar: an older name: use ReactiveFallback
BlackboardCheckInt BlackboardCheckDouble BlackboardCheckString: an older name: use Precondition"""
UNSUPPORTED_NODES: Final = {
    node: why
    for names, _, why in (line.partition(": ") for line in _REMEDIES.strip().splitlines())
    for node in names.split()
}
"""Unsupported nodes of BehaviorTree.CPP and Nav2, and their replacements."""

PRECONDITIONS: Final = ("_failureIf", "_successIf", "_skipIf", "_while")
"""Conditions before a node, in their order."""
POSTCONDITIONS: Final = ("_onHalted", "_onFailure", "_onSuccess", "_post")
"""Scripts after the end of a node."""
CONDITIONS: Final = (*PRECONDITIONS, *POSTCONDITIONS)
REMARKS: Final = frozenset(
    {"_uid", "_fullpath", "_description", "_collapsed", "_favorite", "_hardcoded"}
)
"""Attributes of editors, which are passed over."""

LINK_UP: Final = "LINK_UP"
LINK_SILENT_S: Final = "LINK_SILENT_S"
MODE: Final = "MODE"
BATTERY_CHARGE: Final = "BATTERY_CHARGE"
ENERGY_USED: Final = "ENERGY_USED"
UTC: Final = "UTC"
TELEMETRY: Final[Mapping[str, str]] = MappingProxyType(
    {
        **{each.value: f"{each.description}, {each.unit}" for each in Parameter},
        LINK_UP: "1 while the ground is in contact, else 0",
        LINK_SILENT_S: "Time since the last contact with the ground, s",
        MODE: "Mode of the asset: IDLE, MOVING, PLAN …",
        BATTERY_CHARGE: "Charge of the battery, 0 to 1",
        ENERGY_USED: "Energy used since the plan began, J",
        UTC: "Time, s since 1970-01-01 UTC",
    }
)
"""Telemetry that scripts read as `@NAME`, with its meaning and unit."""
