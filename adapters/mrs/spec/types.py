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
    """Whether a parameter value can be used."""

    VALID = 0
    EXPIRED = 1
    INVALID_RAW = 2
    INVALID_CONVERSION = 3
    UNVERIFIED = 4
    INVALID = 5


class AssetMode(Enum):
    """What the asset is about.

    Attributes:
        TELEOP: Open velocity command active.
        PLAN: Plan running.
        STOPPED: Latched by stop, needs resume.
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
    """What an asset does about a fault.

    Attributes:
        WARN: Goes on, with an event.
        SLOW_DOWN: Goes on at lower speeds.
        PAUSE: Stands; motion waits.
        STOP: Stands; motion FAILED.
        SAFE: Stands in mode SAFE; motion FAILED.
    """

    WARN = 1
    SLOW_DOWN = 2
    PAUSE = 3
    STOP = 4
    SAFE = 5


class Controller(Enum):
    """What drives an asset to a place.

    Attributes:
        TURN_DRIVE: Turns on the spot and straight lines.
        MPC: Curves in the least time: model predictive control. Not every asset offers it.
    """

    TURN_DRIVE = 1
    MPC = 2


class NodeKind(Enum):
    """What a node of the behaviour tree is.

    Attributes:
        SELECTOR: The first child that does not fail.
        SEQUENCE: All children, one after the other.
        PARALLEL: All children at once.
        DECORATOR: Runs its child again, in time, or inverted.
        CONDITION: Checks, never acts.
        TAKE: Takes a goal of a queue.
        LEAF: Acts.
        PLANNED: Of a plan; which kind is not known.
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
    """What a node of the behaviour tree did when it was last ticked.

    Attributes:
        IDLE: That was not in the last tick.
    """

    IDLE = 1
    RUNNING = 2
    SUCCESS = 3
    FAILURE = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandHeader:
    """The identity of a command and how it is to be handled; the first part of every command.

    Attributes:
        commandId: Unique per source for ever, never 0 (MOPS field moeinputsid). Echoed in every
            notification.
        source: Commanding entity, e.g. MOE-1: 256 printable characters at most.
        counter: MOPS field moeinputscounter, display only.
        lifetime: Seconds from creationTime after which the command must not start. NULL: it does
            not age. (s)
        creationTime: When the source made it. NULL: the lifetime counts from its arrival. (ns since
            1970 UTC)
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
    """One fact that an asset reports.

    Attributes:
        kind: What it is about.
        severity: How much it should worry the operator.
        timestamp: On-board time of the fact. (ns since 1970 UTC)
        sequence: Per asset, in the order of events aboard, one more each. At an orbiter 0: it has
            no number.
        commandId: The command. NULL unless kind is COMMAND, or it is the prediction of a command's
            motion: kind EVENT, stage NULL.
        source: Source of that command.
        stage: Stage that the command reached. NULL unless kind is COMMAND.
        step: PROGRESS: step now.
        stepCount: PROGRESS: steps expected.
        code: Why, as a number: on REJECTED, FAILED and CANCELLED, and on events that have one (PUS
            failure notice code).
        text: For the operator.
        parameters: Failure data or results. A name that begins with 'predicted ' is of the
            prediction, and goes with the name that follows.
        cursor: Per provider, in the order of recording, to catch up by getNotifications. Equal to
            the sequence aboard. NULL: it is not recorded.
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
    """What a monitoring parameter means.

    Attributes:
        name: Its name.
        description: Its meaning.
        type: Type of its values.
        unit: Unit of its values, UCUM-like (m, rad, m/s, rad/s, V). NULL: a number without unit.
        writable: TRUE: a command sets it.
    """

    name: str
    description: str
    type: AttributeType
    unit: str | None = None
    writable: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterValue:
    """A monitoring parameter at a moment.

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
    """Where the asset is.

    A figure that is not known is NaN.

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
    """How fast the asset may move, and does.

    A figure that is not known is NaN.

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
    """A place to reach.

    Attributes:
        x: m.
        y: m.
        heading: rad. NULL: do not turn at the end.
        tolerance: m. NULL: default of the asset.
    """

    x: float
    y: float
    heading: float | None = None
    tolerance: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraState:
    """Where the camera points.

    A figure that is not known is NaN.

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
    """How to take a picture.

    NULL: the camera's own setting.

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
    """What is known of a file of the asset.

    Attributes:
        path: Relative to the monitored folder, parts separated by a slash.
        size: octet.
        modified: When it was last changed. (ns since 1970 UTC)
        mimeType: Its media type.
        checksum: CRC-32 (IEEE 802.3) of the content. NULL: not known yet.
        metaData: Whatever else is known, e.g. commandId, POS_X, CAM_PAN at capture.
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
        offset: Where it begins in the file, octet.
        data: The octets.
    """

    offset: int
    data: bytes


@dataclass(frozen=True, slots=True, kw_only=True)
class FileReport:
    """What was transferred.

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
    """A plan to carry out.

    Attributes:
        planId: Its name, unique in the asset.
        name: Its title, for the operator.
        format: Format of the content, e.g. BTCPP4, SCXML, MOPS.
        content: The plan, 256 KiB (262,144 octets) at most.
        arguments: Blackboard input, 256 at most.
    """

    planId: str
    name: str
    format: str
    content: bytes
    arguments: tuple[NamedValue, ...] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanUpdate:
    """How far a plan has come.

    Attributes:
        planId: The plan.
        status: Where it is in its life.
        timestamp: On-board time of the fact. (ns since 1970 UTC)
        node: Path of the active node.
        done: Leaf actions finished.
        total: Leaf actions known.
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
    """What a client talks to.

    Attributes:
        asset: Its name.
        domain: Its MAL domain, under which it publishes.
        description: For the operator.
        softwareVersion: Version of the software aboard.
        mode: What it is about now.
    """

    asset: str
    domain: tuple[str, ...]
    description: str
    softwareVersion: str
    mode: AssetMode


@dataclass(frozen=True, slots=True, kw_only=True)
class ServiceDescriptor:
    """A service and where it is served.

    Attributes:
        name: Name of the service.
        service: Area, service and area version.
        providerURI: Where its provider is: maltcp://host:port/name, 256 characters at most.
        brokerURI: Where its broker is. NULL: it has no PUBSUB operation.
        operations: Numbers of the operations that work here: 1 to 256, each once.
    """

    name: str
    service: ServiceId
    providerURI: str
    brokerURI: str | None = None
    operations: tuple[int, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class AssetStatus:
    """The state of an asset at a moment.

    Attributes:
        timestamp: On-board time. (ns since 1970 UTC)
        mode: What it is about.
        activeCommandId: The command under way.
        queuedCommands: Commands that wait.
        activePlan: The plan under way.
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
    """Who may command the asset.

    Attributes:
        holder: Who holds the authority. NULL: nobody.
        epoch: Number of the last grant: one more with each. 0: none was granted yet.
        leaseLeft: Time until the holder loses it, if it gives no sign. 0: nobody holds it. (s)
        lease: Time that a holder may be silent: each of its commands and requests renews it. (s)
        askedBy: Who asked for it last, since it was granted.
        needed: Whether commands need it.
        caller: Name by which the caller's certificate makes it known, under which alone it
            commands. NULL: in clear text, where any name is taken.
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
    """A fault that has begun and is not over.

    Attributes:
        name: Its name in the asset's fault table.
        began: On-board time at which it began. (ns since 1970 UTC)
        severity: How much it should worry the operator.
        reaction: What the asset does about it.
        onResume: TRUE: a resume ends it, once its cause is gone. FALSE: it ends with its cause.
        code: Its reason, as in notifications.
        text: What showed it when it began, for the operator: 4096 characters at most.
        parameters: The figures behind that.
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
    """What the asset's monitors know at a moment.

    Attributes:
        timestamp: On-board time. (ns since 1970 UTC)
        why: Why the asset stands, or what moves it: one line for the operator, of 4096 characters
            at most.
        active: The faults that are not over, oldest first: each name once.
        unmonitored: What is not monitored, for want of a sensor or because the asset's file says
            so.
    """

    timestamp: int
    why: str
    active: tuple[ActiveFault, ...]
    unmonitored: tuple[Unmonitored, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class PreviewPose:
    """Where the asset would be at a time.

    Attributes:
        time: Since the beginning. (s)
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
    """What a motion or a plan would come to.

    Attributes:
        duration: From its start to standing at its end. (s)
        length: m, of the path of base_link.
        frame: Frame of reference of the path.
        path: Evenly in time, 200 at most; the last is the end.
        endWithin: m. How far from the end of the path it may stand, at 2 sigma.
        headingWithin: rad. By how much its heading may be another, at 2 sigma.
        energy: J, of the battery. NULL: not known of this asset.
        clearance: m, the least distance to zones and known rocks of the disc in which it turns.
            NULL: none is known.
        nearest: To what that is, for the operator.
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
    """The behaviour tree as of a tick.

    Attributes:
        whole: Number of the whole tree that this is, or that it differs from.
        timestamp: On-board time. (ns since 1970 UTC)
        tick: Number of the tick.
        mode: What the asset is about.
        activeSource: Source of the command under way. NULL: none is.
        activeCommandId: The command under way. NULL: none is.
        why: Why the asset stands, or what moves it: one line.
        faults: The active faults, a line each.
        unmonitored: What is not monitored. NULL: as in the whole.
        nodes: All nodes, depth first. NULL: as in the whole, but for the changes.
        changes: The nodes that differ from the whole. NULL in a whole.
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
        path: Names from the root, joined by slashes. NULL: that of its parent, a slash, and its
            name.
        depth: Steps from the root; its parent is the last node before it of one step less.
        kind: What it is.
        status: What it did in the last tick.
        message: What it says of itself. NULL: nothing.
    """

    name: str
    path: str | None = None
    depth: int
    kind: NodeKind
    status: NodeStatus
    message: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class NodeChange:
    """How a node is now.

    Attributes:
        index: Its place among the nodes of the whole, from 0.
        status: What it did in the last tick.
        message: What it says of itself. NULL: nothing.
    """

    index: int
    status: NodeStatus
    message: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class History:
    """What is known of a time aboard, so that it can be explained.

    Attributes:
        until: On-board time at which it ends: now. (ns since 1970 UTC)
        reports: In the order of their numbers.
        asked: Commands, in the order of their arrival.
        declined: Commands that have no life of their own.
        situations: What the asset was about, in the order of time.
        leaves: When leaves of the behaviour tree ran.
        fastest: The greatest speeds.
        slowing: Reasons of the faults for which the asset slows down.
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
    """A notification as the asset keeps it: with the link of the command, and with units.

    Attributes:
        notification: The notification, without parameters.
        source: Source of the command that it is of, whatever its kind is. NULL: of none.
        commandId: That command. NULL: of none.
        link: Link by which the command came. NULL: of no command.
        figures: The figures behind it.
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
        name: What it is of.
        value: The number.
        unit: As people read it. NULL: a count.
    """

    name: str
    value: float
    unit: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class AskedCommand:
    """A command as it arrived.

    Attributes:
        source: Who asked.
        commandId: Under which number.
        text: What for, with its arguments and their units, for people.
        name: Name of the request.
        link: By which link.
        timestamp: On-board time of its arrival. (ns since 1970 UTC)
        replaces: Whether it was to replace the motion under way.
        creationTime: When it was made, as its sender said. (ns since 1970 UTC)
        lifetime: How long it may wait, as its sender said. (s)
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
    """A command that was not taken under its number.

    Attributes:
        source: Who asked.
        commandId: Under which number.
        timestamp: On-board time. (ns since 1970 UTC)
        code: The reason, as in notifications.
        text: The reason, for the operator.
        figures: The figures behind it.
    """

    source: str
    commandId: int
    timestamp: int
    code: int
    text: str
    figures: tuple[FigureWithUnit, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Situation:
    """What the asset was about from a time on.

    Attributes:
        timestamp: On-board time. (ns since 1970 UTC)
        mode: Its mode.
        activeSource: Source of the command under way. NULL: none was.
        activeCommandId: The command under way. NULL: none was.
        why: Why it stood, or what moved it: one line.
    """

    timestamp: int
    mode: AssetMode
    activeSource: str | None = None
    activeCommandId: int | None = None
    why: str


@dataclass(frozen=True, slots=True, kw_only=True)
class LeafRun:
    """A time for which a leaf of the behaviour tree ran.

    Attributes:
        path: Names from the root, joined by slashes.
        began: On-board time. (ns since 1970 UTC)
        ended: On-board time. NULL: it runs. (ns since 1970 UTC)
        message: What it said of itself last. NULL: nothing.
    """

    path: str
    began: int
    ended: int | None = None
    message: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class FastestTravel:
    """The greatest speed that was commanded within a command.

    Attributes:
        source: Who asked for the command.
        commandId: Under which number.
        speed: m/s.
        allowed: m/s, the greatest that the asset allows.
    """

    source: str
    commandId: int
    speed: float
    allowed: float
