"""Types of area MRS, generated from mrs.xml."""

# ruff: noqa: N815 - names are those of the specification

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import executive.faults
import executive.values.plan_nodes
import executive.values.reports
from adapters.mal import AttributeType, NamedValue, ServiceId, TypedAttribute

Stage = executive.values.reports.Stage
Severity = executive.values.reports.Severity
NotificationKind = executive.values.reports.ReportKind
PlanStatus = executive.values.reports.PlanStatus
NodeStatus = executive.values.plan_nodes.NodeStatus
FileEventType = executive.values.reports.FileEventKind
Unmonitored = executive.faults.Unmonitored


class Validity(Enum):
    """Validity of a parameter value."""

    VALID = 0
    EXPIRED = 1
    INVALID_RAW = 2
    INVALID_CONVERSION = 3
    UNVERIFIED = 4
    INVALID = 5


class AssetMode(Enum):
    """Mode of the asset.

    Attributes:
        TELEOP: A velocity command (drive) is active.
        PLAN: A plan is active.
        STOPPED: The asset is stationary until resume.
        SAFE: A fault reaction holds the asset stationary until resume.
    """

    IDLE = 1
    MOVING = 2
    TELEOP = 3
    PLAN = 4
    PAUSED = 5
    STOPPED = 6
    SAFE = 7
    OFFLINE = 8


class FaultReaction(Enum):
    """Reaction of an asset to a fault.

    Attributes:
        WARN: The asset continues, and sends an event.
        SLOW_DOWN: The asset continues at lower speeds.
        PAUSE: The asset is stationary, and its motion waits.
        STOP: The asset is stationary, and its motion has FAILED.
        SAFE: The asset is stationary in mode SAFE, and its motion has FAILED.
    """

    WARN = 1
    SLOW_DOWN = 2
    PAUSE = 3
    STOP = 4
    SAFE = 5


class Controller(Enum):
    """Controller of a motion to a target.

    Attributes:
        TURN_DRIVE: Drives by turns on the spot and straight lines.
        MPC: Drives along time-optimal curves by model predictive control. Not every asset has it.
        NAVIGATION: Drives by the navigation below the executive. Not every asset has one.
    """

    TURN_DRIVE = 1
    MPC = 2
    NAVIGATION = 3


class NodeKind(Enum):
    """Type of a node of the behaviour tree.

    Attributes:
        SELECTOR: Ticks children until one does not fail.
        SEQUENCE: Runs all children in order.
        PARALLEL: Runs all children at the same time.
        DECORATOR: Repeats, times or inverts its child.
        CONDITION: Checks without acting.
        TAKE: Activates a queued goal.
        LEAF: Acts.
        PLANNED: Node of a plan, of unknown type.
    """

    SELECTOR = 1
    SEQUENCE = 2
    PARALLEL = 3
    DECORATOR = 4
    CONDITION = 5
    TAKE = 6
    LEAF = 7
    PLANNED = 8


class PlanCheckLevel(Enum):
    """Depth of a check of a plan.

    Attributes:
        CHECK: Looks for probable faults in the text.
        PROVE: Explores the outcomes of all steps, conditions, questions, timers and stops.
        TRY: Runs the plan in simulation, several times.
    """

    CHECK = 1
    PROVE = 2
    TRY = 3


class PlanVerdict(Enum):
    """Result of a check of a plan.

    Attributes:
        REFUSED: The asset would refuse the plan.
        FAULTS: Probable faults were found.
        NO_FAULT_FOUND: No fault was found, but not all was explored.
        PROVED: All outcomes were explored, without a fault.
        TRIED: The plan ran in simulation; the trial has the results.
    """

    REFUSED = 1
    FAULTS = 2
    NO_FAULT_FOUND = 3
    PROVED = 4
    TRIED = 5


class FindingLevel(Enum):
    """Weight of a finding on a plan.

    Attributes:
        ERROR: The plan probably does not do what it should.
        WARNING: The plan can do something unexpected.
        NOTE: Information.
    """

    ERROR = 1
    WARNING = 2
    NOTE = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandHeader:
    """Identity and handling of a command; the first part of every command.

    Attributes:
        commandId: Number of the command. It is never 0, and the source never uses it again (MOPS
            field moeinputsid). Every notification of the command repeats it.
        source: Name of the sender, e.g. MOE-1: at most 256 printable characters.
        counter: MOPS field moeinputscounter, used for display only.
        lifetime: Seconds from creationTime after which the command must not start. NULL: no expiry.
            (s)
        creationTime: Time of creation at the source. NULL: the lifetime counts from reception. (ns
            since 1970 UTC)
        reportStarted: TRUE: send STARTED.
        reportProgress: TRUE: send PROGRESS.
    """

    commandId: int
    source: str
    counter: int | None = None
    lifetime: float | None = None
    creationTime: int | None = None
    reportStarted: bool
    reportProgress: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Notification:
    """A report of an asset.

    Attributes:
        kind: Subject of the notification.
        severity: Its severity for the operator.
        timestamp: On-board time of the event. (ns since 1970 UTC)
        sequence: Number of the report. The asset increments it by one with each report. 0 at an
            orbiter: the report has no number.
        commandId: Number of the command. NULL unless kind is COMMAND, or the notification is an
            event that predicts the motion of a command (kind EVENT, stage NULL).
        source: Source of that command.
        stage: Stage that the command reached. NULL unless kind is COMMAND.
        step: In PROGRESS: number of the present step.
        stepCount: In PROGRESS: number of all steps.
        code: Number of the reason of a REJECTED, FAILED or CANCELLED, or of an event that has a
            reason (PUS-C failure notice code).
        text: For the operator.
        parameters: Failure data or results. A parameter whose name is 'predicted ' and another name
            is the predicted value of the parameter with that name.
        cursor: Position of the notification in the record of this provider, for getNotifications.
            Aboard it equals the sequence. NULL: the notification is not recorded.
        fault: Name, in the asset's fault table, of the fault that began, cleared, made the pose
            uncertain or ended the command. NULL: none.
        causeSource: Source of the other command that ended the command. NULL: none.
        causeCommandId: Number of the other command that ended the command. NULL: none.
        publishers: In an event that reports a change of the other publishers of velocities: the
            names of all these publishers. NULL in other notifications.
    """

    kind: NotificationKind
    severity: Severity
    timestamp: int
    sequence: int
    commandId: int | None = None
    source: str | None = None
    stage: Stage | None = None
    step: int | None = None
    stepCount: int | None = None
    code: int | None = None
    text: str | None = None
    parameters: tuple[NamedValue, ...] | None = None
    cursor: int | None = None
    fault: str | None = None
    causeSource: str | None = None
    causeCommandId: int | None = None
    publishers: tuple[str, ...] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterDefinition:
    """Definition of a monitoring parameter.

    Attributes:
        name: Its name.
        description: Its meaning.
        type: Type of its values.
        unit: Unit of its values, UCUM-like (m, rad, m/s, rad/s, V). NULL: a number without unit.
        writable: TRUE: a command can set the parameter.
    """

    name: str
    description: str
    type: AttributeType
    unit: str | None = None
    writable: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterValue:
    """Sample of a monitoring parameter.

    Attributes:
        name: Its name.
        timestamp: Sampling time. (ns since 1970 UTC)
        validity: Whether the value can be used.
        value: Its value. NULL when the value is not valid.
    """

    name: str
    timestamp: int
    validity: Validity
    value: TypedAttribute | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """Pose of the asset.

    Unknown figures are NaN.

    Attributes:
        frame: Frame of reference, odom by default.
        x: POS_X, m.
        y: POS_Y, m.
        z: POS_Z, m.
        heading: HEAD, rad, in ]-pi, pi], counter-clockwise from the x axis of the frame.
    """

    frame: str
    x: float
    y: float
    z: float
    heading: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Speeds:
    """Maximum and present speeds of the asset.

    Unknown figures are NaN.

    Attributes:
        travelSpeed: TRAVEL_SPEED, maximum, m/s.
        rotateSpeed: ROTATE_SPEED, maximum, rad/s.
        currentTravelSpeed: CURRENT_TRAVEL_SPEED, m/s.
        currentRotateSpeed: CURRENT_ROTATE_SPEED, rad/s.
    """

    travelSpeed: float
    rotateSpeed: float
    currentTravelSpeed: float
    currentRotateSpeed: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Waypoint:
    """Target of a motion.

    Attributes:
        x: m.
        y: m.
        heading: rad. NULL: no turn at the end.
        tolerance: m. NULL: the default of the asset.
    """

    x: float
    y: float
    heading: float | None = None
    tolerance: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraState:
    """Angles of the camera.

    Unknown figures are NaN.

    Attributes:
        pan: CAM_PAN, rad, counter-clockwise positive.
        tilt: CAM_TILT, rad, upward positive.
        rotateSpeed: CAM_ROTATE_SPEED, maximum, rad/s.
        videoOn: TRUE: the video stream runs.
    """

    pan: float
    tilt: float
    rotateSpeed: float
    videoOn: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureSettings:
    """Settings of a picture.

    The camera's default is used for a setting that is NULL.

    Attributes:
        width: pixel.
        height: pixel.
        format: JPG, PNG or RAW.
        quality: 1 to 100.
    """

    width: int | None = None
    height: int | None = None
    format: str | None = None
    quality: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class FileInfo:
    """Attributes of a file of the asset.

    Attributes:
        path: Path relative to the monitored folder, with slashes between its parts.
        size: octet.
        modified: Time of the last change. (ns since 1970 UTC)
        mimeType: Its media type.
        checksum: CRC-32 (IEEE 802.3) of the content. NULL: not computed yet.
        metaData: Other attributes, e.g. commandId, and POS_X and CAM_PAN at the time of the
            picture.
    """

    path: str
    size: int
    modified: int
    mimeType: str | None = None
    checksum: int | None = None
    metaData: tuple[NamedValue, ...] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class FileChunk:
    """A part of a file's content.

    Attributes:
        offset: Offset of its first octet in the file.
        data: The octets.
    """

    offset: int
    data: bytes


@dataclass(frozen=True, slots=True, kw_only=True)
class FileReport:
    """Result of a file transfer.

    Attributes:
        path: The file.
        octets: Octets sent.
        checksum: CRC-32 of the whole file.
    """

    path: str
    octets: int
    checksum: int


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanDefinition:
    """A plan to execute.

    Attributes:
        planId: Its name, unique in the asset.
        name: Its title for the operator.
        format: Format of the content, e.g. BTCPP4, SCXML, MOPS.
        content: The plan, at most 256 KiB (262,144 octets).
        arguments: Arguments of the plan, at most 256.
    """

    planId: str
    name: str
    format: str
    content: bytes
    arguments: tuple[NamedValue, ...] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanUpdate:
    """Execution status of a plan.

    Attributes:
        planId: The plan.
        status: Its stage of the life cycle.
        timestamp: On-board time of the event. (ns since 1970 UTC)
        node: Path of the active node.
        done: Number of leaves that have ended at least once or were skipped.
        total: Number of leaves of the plan.
        text: For the operator.
    """

    planId: str
    status: PlanStatus
    timestamp: int
    node: str | None = None
    done: int | None = None
    total: int | None = None
    text: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class AssetInfo:
    """Description of an asset.

    Attributes:
        asset: Its name.
        domain: The MAL domain of its updates.
        description: For the operator.
        softwareVersion: Version of the on-board software.
        mode: Its present mode.
    """

    asset: str
    domain: tuple[str, ...]
    description: str
    softwareVersion: str
    mode: AssetMode


@dataclass(frozen=True, slots=True, kw_only=True)
class ServiceDescriptor:
    """A service and its addresses.

    Attributes:
        name: Name of the service.
        service: Area, service and area version.
        providerURI: URI of its provider: maltcp://host:port/name, at most 256 characters.
        brokerURI: URI of its broker. NULL: no PUBSUB operation.
        operations: Numbers of the supported operations: 1 to 256 numbers, each listed once.
    """

    name: str
    service: ServiceId
    providerURI: str
    brokerURI: str | None = None
    operations: tuple[int, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class AssetStatus:
    """State of an asset at one time.

    Attributes:
        timestamp: On-board time. (ns since 1970 UTC)
        mode: Its mode.
        activeCommandId: Number of the active command.
        queuedCommands: Queued commands.
        activePlan: Id of the active plan.
        values: All parameters.
    """

    timestamp: int
    mode: AssetMode
    activeCommandId: int | None = None
    queuedCommands: int
    activePlan: str | None = None
    values: tuple[ParameterValue, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class AuthorityStatus:
    """Status of the command authority.

    Attributes:
        holder: Holder of the authority. NULL: none.
        epoch: Number of the last grant, incremented by each grant. 0: no grant yet.
        leaseLeft: Time until the lease expires if the holder sends no message. 0: no holder. (s)
        lease: Duration of the lease. Each command and each request of the holder renews the lease.
            (s)
        requestedBy: Last source that requested the authority since the grant. NULL: none.
        needed: TRUE: commands need the authority.
        caller: Name in the caller's certificate, the only source that its commands may have. NULL:
            the connection is in clear text, and any source is accepted.
    """

    holder: str | None = None
    epoch: int
    leaseLeft: float
    lease: float
    requestedBy: str | None = None
    needed: bool
    caller: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ActiveFault:
    """A fault that is active.

    Attributes:
        name: Its name in the asset's fault table.
        began: On-board time of its start. (ns since 1970 UTC)
        severity: Its severity for the operator.
        reaction: Reaction of the asset.
        onResume: TRUE: a resume clears the fault after its cause has ended. FALSE: the fault clears
            as soon as its cause ends.
        code: Number of its reason, as in notifications.
        text: Its evidence at the start, for the operator: at most 4096 characters.
        parameters: The figures of the evidence.
    """

    name: str
    began: int
    severity: Severity
    reaction: FaultReaction
    onResume: bool
    code: int
    text: str
    parameters: tuple[NamedValue, ...] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultStatus:
    """State of the asset's monitors at one time.

    Attributes:
        timestamp: On-board time. (ns since 1970 UTC)
        why: Reason for standstill or motion: one line for the operator, at most 4096 characters.
        active: The active faults, oldest first: each name once.
        unmonitored: Checks that do not run, because a sensor is missing or the asset's settings
            omit them.
    """

    timestamp: int
    why: str
    active: tuple[ActiveFault, ...]
    unmonitored: tuple[Unmonitored, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class PreviewPose:
    """Predicted pose at one time.

    Attributes:
        time: Time from the start of the prediction. (s)
        x: m.
        y: m.
        heading: rad, in ]-pi, pi].
    """

    time: float
    x: float
    y: float
    heading: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Preview:
    """Prediction of a motion or plan.

    Attributes:
        duration: Time from the start of the motion to the standstill at its end. (s)
        length: m. Length of the path of base_link.
        frame: Frame of reference of the path.
        path: Poses at equal time steps, at most 200. The last pose is the end of the motion.
        endUncertainty: m. Maximum distance from the end of the path, 2 sigma.
        headingUncertainty: rad. Maximum deviation of the heading at the end, 2 sigma.
        energy: J, of the battery. NULL: unknown for this asset.
        clearance: m. Minimum distance from the disc swept by the turning footprint to zones and
            known rocks. NULL: none known.
        nearest: The zone or rock at that distance, for the operator.
        note: A restriction, for the operator: e.g. straight lines instead of the navigation's path.
            NULL: none.
    """

    duration: float
    length: float
    frame: str
    path: tuple[PreviewPose, ...]
    endUncertainty: float
    headingUncertainty: float
    energy: float | None = None
    clearance: float | None = None
    nearest: str | None = None
    note: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class TreeUpdate:
    """The behaviour tree at one tick.

    Attributes:
        whole: Number of the full tree: of this one, or of the one to which the differences refer.
        timestamp: On-board time. (ns since 1970 UTC)
        tick: Number of the tick.
        mode: Mode of the asset.
        activeSource: Source of the active command. NULL: none.
        activeCommandId: Number of the active command. NULL: none.
        why: Reason for standstill or motion: one line.
        faults: The active faults.
        unmonitored: Checks that do not run. NULL: as in the full tree.
        nodes: All nodes, depth first. NULL: as in the full tree, except for the changes.
        changes: The nodes that differ from the full tree. NULL in a full tree.
    """

    whole: int
    timestamp: int
    tick: int
    mode: AssetMode
    activeSource: str | None = None
    activeCommandId: int | None = None
    why: str
    faults: tuple[TreeFault, ...]
    unmonitored: str | None = None
    nodes: tuple[TreeNode, ...] | None = None
    changes: tuple[NodeChange, ...] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class TreeNode:
    """A node of the behaviour tree.

    Attributes:
        name: Its name.
        path: Names from the root, joined by slashes. NULL: the path of its parent, a slash, and its
            name.
        depth: Levels below the root. The parent of a node is the last node before it whose depth is
            smaller by one.
        kind: Type of the node.
        status: Result of the last tick.
        message: Its message. NULL: none.
    """

    name: str
    path: str | None = None
    depth: int
    kind: NodeKind
    status: NodeStatus
    message: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeChange:
    """New state of a node.

    Attributes:
        index: Index in the nodes of the full tree, from 0.
        status: Result of the last tick.
        message: Its message. NULL: none.
    """

    index: int
    status: NodeStatus
    message: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class History:
    """Recorded history of a period, which explains commands and modes.

    Attributes:
        until: On-board time of the end of the period, which is the present. (ns since 1970 UTC)
        reports: Reports, in the order of their sequence numbers.
        commands: Commands, in the order of reception.
        declined: Commands that were refused without a life cycle of their own.
        states: Modes of the asset, in the order of time.
        leaves: Runs of leaves of the behaviour tree. For plans also: decisions of their nodes while
            they are in force.
        fastest: Maximum commanded speed of each command.
        slowing: Numbers of the reasons of the faults with the reaction SLOW_DOWN.
    """

    until: int
    reports: tuple[PastReport, ...]
    commands: tuple[ReceivedCommand, ...]
    declined: tuple[DeclinedCommand, ...]
    states: tuple[ExecutiveState, ...]
    leaves: tuple[LeafRun, ...]
    fastest: tuple[FastestTravel, ...]
    slowing: tuple[int, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class PastReport:
    """A notification as recorded: with the link of the command and with units.

    Attributes:
        notification: The notification, without parameters.
        source: Source of its command, also in a notification of another kind than COMMAND. NULL: no
            command.
        commandId: Number of its command. NULL: no command.
        link: Link of its command. NULL: no command.
        figures: Its figures.
    """

    notification: Notification
    source: str | None = None
    commandId: int | None = None
    link: str | None = None
    figures: tuple[FigureWithUnit, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class FigureWithUnit:
    """A number with its unit.

    Attributes:
        name: Name of the quantity.
        value: Its value.
        unit: Unit for display. NULL: a count.
    """

    name: str
    value: float
    unit: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ReceivedCommand:
    """A command as received.

    Attributes:
        source: Source of the command.
        commandId: Number of the command.
        text: Description with arguments and units, for display.
        name: Name of the request.
        link: Link of the command.
        timestamp: On-board time of reception. (ns since 1970 UTC)
        replaces: TRUE: the command replaces the active and queued motions.
        creationTime: Time of creation at the source. (ns since 1970 UTC)
        lifetime: Maximum age at its start, set by the source. (s)
    """

    source: str
    commandId: int
    text: str
    name: str
    link: str
    timestamp: int
    replaces: bool
    creationTime: int | None = None
    lifetime: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class DeclinedCommand:
    """A command that was refused without a life cycle of its own.

    Attributes:
        source: Source of the command.
        commandId: Number of the command.
        timestamp: On-board time. (ns since 1970 UTC)
        code: Number of the reason, as in notifications.
        text: The reason, for the operator.
        figures: Its figures.
    """

    source: str
    commandId: int
    timestamp: int
    code: int
    text: str
    figures: tuple[FigureWithUnit, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ExecutiveState:
    """Mode of the asset, and the time from which it held.

    Attributes:
        timestamp: On-board time. (ns since 1970 UTC)
        mode: Its mode.
        activeSource: Source of the active command. NULL: none.
        activeCommandId: Number of the active command. NULL: none.
        why: Reason for standstill or motion: one line.
        fault: Name of the fault that holds the rover. NULL: none.
        causeSource: Source of the stop that holds the rover. NULL: none.
        causeCommandId: Number of the stop that holds the rover. NULL: none.
    """

    timestamp: int
    mode: AssetMode
    activeSource: str | None = None
    activeCommandId: int | None = None
    why: str
    fault: str | None = None
    causeSource: str | None = None
    causeCommandId: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class LeafRun:
    """A run of a leaf of the behaviour tree.

    Attributes:
        path: Names of the nodes from the root to the leaf, joined by slashes.
        began: On-board time. (ns since 1970 UTC)
        ended: On-board time. NULL: still running. (ns since 1970 UTC)
        message: Its last message. NULL: none.
    """

    path: str
    began: int
    ended: int | None = None
    message: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class FastestTravel:
    """Maximum commanded speed during a command.

    Attributes:
        source: Source of the command.
        commandId: Number of the command.
        speed: m/s.
        allowed: m/s, the maximum of the asset.
    """

    source: str
    commandId: int
    speed: float
    allowed: float


@dataclass(frozen=True, slots=True, kw_only=True)
class TreeFault:
    """A fault that is active.

    Attributes:
        name: Its name in the asset's fault table.
        severity: Its severity for the operator.
        text: Its evidence at the start, for the operator: at most 4096 characters.
    """

    name: str
    severity: Severity
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ScannedObstacle:
    """A part of an obstacle that the laser detected, as a circle.

    Attributes:
        x: Centre, m.
        y: Centre, m.
        radius: m.
    """

    x: float
    y: float
    radius: float


@dataclass(frozen=True, slots=True, kw_only=True)
class PreviewStep:
    """Prediction of one step of a plan.

    Attributes:
        node: Path of the leaf, as in PlanUpdate.
        duration: Time from its start to its end. 0 for a step without motion. (s)
        length: m. Length of the path of base_link.
        end: Pose at its end; the time is from the start of the plan.
        energy: J, of the battery. NULL: unknown for this asset.
        clearance: m. Minimum distance as in Preview. NULL: none known, or no motion.
        nearest: The zone or rock at that distance, for the operator.
        refusal: Why it would be refused or fail. NULL: it would succeed.
    """

    node: str
    duration: float
    length: float
    end: PreviewPose
    energy: float | None = None
    clearance: float | None = None
    nearest: str | None = None
    refusal: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanPreview:
    """Prediction of a plan and of its steps.

    Attributes:
        total: Prediction of the plan. NULL: it would be refused or fail.
        steps: The predicted steps in order, at most 1000.
        refusal: Why the plan would be refused or fail, with the step. NULL: it would succeed.
    """

    total: Preview | None = None
    steps: tuple[PreviewStep, ...]
    refusal: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanQuestion:
    """An open question of a plan to the operators.

    Attributes:
        key: Path of its node, as answerQuestion takes it.
        text: The question.
        options: The answers that it accepts.
        default: The answer at the deadline. NULL: the node fails then.
        until: The deadline. NULL: none. (ns since 1970 UTC)
    """

    key: str
    text: str
    options: tuple[str, ...]
    default: str | None = None
    until: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanNode:
    """A node of a plan.

    Attributes:
        path: Names from the root joined by slashes; unique in the plan.
        kind: Name of its kind in the text of the plan, e.g. Fallback.
        line: Line of the text.
        status: Its present status. IDLE: it has not begun, or was reset or halted.
        result: Result of its last end, SUCCESS or FAILURE. NULL: it has not ended.
        timestamp: When it began, ended or was halted last. NULL: it has not begun. (ns since 1970
            UTC)
        tries: How often it began. A node that ends at once with its last result again counts once.
        code: Number of the reason of its last failure, as in notifications. NULL: it was not that
            of a command.
        text: Why it failed last.
        unknown: Telemetry or variable that it needs and that is not known.
        decision: Which branch it took last, and why.
        next: End of its wait, deadline or window. (ns since 1970 UTC)
        question: Its question while it is open.
        commandId: Its last command, of the source plan:PLAN.
    """

    path: str
    kind: str
    line: int
    status: NodeStatus
    result: NodeStatus | None = None
    timestamp: int | None = None
    tries: int
    code: int | None = None
    text: str | None = None
    unknown: str | None = None
    decision: str | None = None
    next: int | None = None
    question: PlanQuestion | None = None
    commandId: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanFinding:
    """A probable fault of a plan, or a note on it.

    Attributes:
        level: Its weight.
        line: Line of the text of the plan.
        node: Path of the node below the plan. Empty: the plan as a whole.
        text: The fault and its remedy.
    """

    level: FindingLevel
    line: int
    node: str
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialFigure:
    """The values of a quantity in simulated runs.

    Attributes:
        name: The quantity, e.g. duration, energy, clearance.
        unit: Its unit.
        low: 5 % of the runs are below it.
        median: Median.
        high: 5 % of the runs are above it.
        draws: Number of runs with a value.
    """

    name: str
    unit: str
    low: float
    median: float
    high: float
    draws: int


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialBranch:
    """How often the plan took a branch.

    Attributes:
        node: Path of the node that chose it, below the plan.
        line: Line of the text of the plan.
        choice: The branch.
        draws: Number of runs that took it.
    """

    node: str
    line: int
    choice: str
    draws: int


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanTrial:
    """Summary of simulated runs of a plan.

    Attributes:
        draws: Number of runs.
        successes: Number of runs in which the plan was completed.
        successLow: Lower end of the 95 % interval of the share of success, 0 to 1.
        successHigh: Upper end of it.
        figures: Time, energy, clearance and others.
        branches: The branches.
        worst: The worst run: its number, its end, its clearance in m. NULL: none.
    """

    draws: int
    successes: int
    successLow: float
    successHigh: float
    figures: tuple[TrialFigure, ...]
    branches: tuple[TrialBranch, ...]
    worst: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanCheck:
    """Result of a check of a plan.

    Attributes:
        verdict: The result as a whole.
        leaves: Number of leaves of the plan. NULL: refused.
        commands: Maximum number of its commands. NULL: refused.
        states: Number of explored states. NULL: not explored.
        ticks: Number of explored ticks. NULL: not explored.
        limits: Parts that were not explored exactly, at most 1000.
        findings: Probable faults and notes, at most 1000.
        code: Number of the reason of the refusal. NULL: not refused.
        refusal: Why the asset would refuse the plan. NULL: it would not.
        trial: Summary of the runs of TRY.
    """

    verdict: PlanVerdict
    leaves: int | None = None
    commands: int | None = None
    states: int | None = None
    ticks: int | None = None
    limits: tuple[str, ...]
    findings: tuple[PlanFinding, ...]
    code: int | None = None
    refusal: str | None = None
    trial: PlanTrial | None = None
