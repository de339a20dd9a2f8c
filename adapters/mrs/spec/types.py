"""Types of area MRS, generated from mrs.xml."""

# ruff: noqa: N815 - names are those of the specification

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import executive.safety
import executive.values.reports
from adapters.mal import AttributeType, NamedValue, ServiceId, TypedAttribute

Stage = executive.values.reports.Stage
Severity = executive.values.reports.Severity
NotificationKind = executive.values.reports.ReportKind
PlanStatus = executive.values.reports.PlanStatus
FileEventType = executive.values.reports.FileEventKind
Unmonitored = executive.safety.Unmonitored


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
        TELEOP: Open velocity command active.
        PLAN: Plan active.
        STOPPED: Latched by stop until resume.
        SAFE: Fault reaction active.
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
        WARN: Continues, with an event.
        SLOW_DOWN: Continues at lower speeds.
        PAUSE: Stationary; motion waits.
        STOP: Stationary; motion FAILED.
        SAFE: Stationary in mode SAFE; motion FAILED.
    """

    WARN = 1
    SLOW_DOWN = 2
    PAUSE = 3
    STOP = 4
    SAFE = 5


class Controller(Enum):
    """Controller of a motion to a target.

    Attributes:
        TURN_DRIVE: Turns on the spot and straight lines.
        MPC: Time-optimal curves by model predictive control. Not offered by every asset.
    """

    TURN_DRIVE = 1
    MPC = 2


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


class NodeStatus(Enum):
    """Result of a behaviour-tree node at the last tick.

    Attributes:
        IDLE: Not visited in the last tick.
    """

    IDLE = 1
    RUNNING = 2
    SUCCESS = 3
    FAILURE = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandHeader:
    """Identity and handling of a command; the first part of every command.

    Attributes:
        commandId: Unique for its source forever, never 0 (MOPS field moeinputsid). Repeated in
            every notification of the command.
        source: Commanding entity, e.g. MOE-1: at most 256 printable characters.
        counter: MOPS field moeinputscounter, display only.
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
        kind: Its subject.
        severity: Its severity for the operator.
        timestamp: On-board time of the event. (ns since 1970 UTC)
        sequence: Per asset, incremented by one with each report. 0 at an orbiter: not numbered.
        commandId: The command. NULL unless kind is COMMAND, or the event is a motion prediction of
            a command: kind EVENT, stage NULL.
        source: Source of that command.
        stage: Stage that the command reached. NULL unless kind is COMMAND.
        step: PROGRESS: present step.
        stepCount: PROGRESS: number of steps.
        code: Number of the reason: of REJECTED, FAILED and CANCELLED, and of some events (PUS-C
            failure notice code).
        text: For the operator.
        parameters: Failure data or results. A name that begins with 'predicted ' is the predicted
            value of the name after it.
        cursor: Position in the record of this provider, for getNotifications. Aboard equal to the
            sequence. NULL: not recorded.
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


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterDefinition:
    """Definition of a monitoring parameter.

    Attributes:
        name: Its name.
        description: Its meaning.
        type: Type of its values.
        unit: Unit of its values, UCUM-like (m, rad, m/s, rad/s, V). NULL: a number without unit.
        writable: TRUE: can be set by a command.
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
        value: Its value. NULL when not valid.
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

    NULL: the camera's default.

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
        path: Relative to the monitored folder, separated by slashes.
        size: octet.
        modified: Time of the last change. (ns since 1970 UTC)
        mimeType: Its media type.
        checksum: CRC-32 (IEEE 802.3) of the content. NULL: not computed yet.
        metaData: Other attributes, e.g. commandId, POS_X, CAM_PAN at capture.
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
        arguments: Blackboard input, at most 256.
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
        done: Finished leaf actions.
        total: Known leaf actions.
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
        operations: Numbers of the supported operations: 1 to 256, each once.
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
        mode: Its subject.
        activeCommandId: The active command.
        queuedCommands: Queued commands.
        activePlan: The active plan.
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
        leaseLeft: Time until the lease expires without a message of the holder. 0: no holder. (s)
        lease: Maximum time without a message of the holder. Each of its commands and requests
            renews it. (s)
        askedBy: Last requester since the grant.
        needed: TRUE: commands need the authority.
        caller: Source name of the caller's certificate, the only one for its commands. NULL: clear
            text, any name is accepted.
    """

    holder: str | None = None
    epoch: int
    leaseLeft: float
    lease: float
    askedBy: str | None = None
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
        onResume: TRUE: cleared by a resume after its cause has ended. FALSE: cleared with its
            cause.
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
        unmonitored: Checks that do not run, for lack of a sensor or by the asset's settings.
    """

    timestamp: int
    why: str
    active: tuple[ActiveFault, ...]
    unmonitored: tuple[Unmonitored, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class PreviewPose:
    """Predicted pose at one time.

    Attributes:
        time: From the start of the prediction. (s)
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
        duration: From its start to the standstill at its end. (s)
        length: m, of the path of base_link.
        frame: Frame of reference of the path.
        path: At equal time steps, at most 200; the last is the end.
        endWithin: m. Maximum distance from the end of the path, 2 sigma.
        headingWithin: rad. Maximum deviation of the heading at the end, 2 sigma.
        energy: J, of the battery. NULL: unknown for this asset.
        clearance: m. Minimum distance of the turning circle to zones and known rocks. NULL: none
            known.
        nearest: The zone or rock at that distance, for the operator.
    """

    duration: float
    length: float
    frame: str
    path: tuple[PreviewPose, ...]
    endWithin: float
    headingWithin: float
    energy: float | None = None
    clearance: float | None = None
    nearest: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class TreeUpdate:
    """The behaviour tree at one tick.

    Attributes:
        whole: Number of this full tree, or of the full tree that it differs from.
        timestamp: On-board time. (ns since 1970 UTC)
        tick: Number of the tick.
        mode: Mode of the asset.
        activeSource: Source of the active command. NULL: none.
        activeCommandId: The active command. NULL: none.
        why: Reason for standstill or motion: one line.
        faults: The active faults, one line each.
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
    faults: tuple[str, ...]
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
        depth: Levels below the root. Its parent is the last node before it with a depth one
            smaller.
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
    """Recorded history of a period, to explain it.

    Attributes:
        until: On-board time of its end: now. (ns since 1970 UTC)
        reports: By sequence number.
        asked: Commands, in the order of reception.
        declined: Commands without a life cycle of their own.
        situations: Modes of the asset, in the order of time.
        leaves: Runs of leaves of the behaviour tree.
        fastest: The maximum speeds.
        slowing: Reasons of the faults with reaction SLOW_DOWN.
    """

    until: int
    reports: tuple[PastReport, ...]
    asked: tuple[AskedCommand, ...]
    declined: tuple[DeclinedCommand, ...]
    situations: tuple[Situation, ...]
    leaves: tuple[LeafRun, ...]
    fastest: tuple[FastestTravel, ...]
    slowing: tuple[int, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class PastReport:
    """A notification as recorded: with the link of the command and with units.

    Attributes:
        notification: The notification, without parameters.
        source: Source of its command, for any kind. NULL: no command.
        commandId: Its command. NULL: no command.
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
class AskedCommand:
    """A command as received.

    Attributes:
        source: Source of the command.
        commandId: Number of the command.
        text: Description with arguments and units, for display.
        name: Name of the request.
        link: Link of the command.
        timestamp: On-board time of reception. (ns since 1970 UTC)
        replaces: TRUE: replaces the active motion.
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
class Situation:
    """Mode of the asset from a time on.

    Attributes:
        timestamp: On-board time. (ns since 1970 UTC)
        mode: Its mode.
        activeSource: Source of the active command. NULL: none.
        activeCommandId: The active command. NULL: none.
        why: Reason for standstill or motion: one line.
    """

    timestamp: int
    mode: AssetMode
    activeSource: str | None = None
    activeCommandId: int | None = None
    why: str


@dataclass(frozen=True, slots=True, kw_only=True)
class LeafRun:
    """A run of a leaf of the behaviour tree.

    Attributes:
        path: Names from the root, joined by slashes.
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
