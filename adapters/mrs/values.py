"""The asset's state as MRS values. A figure that is not known is NaN, or a value not VALID."""

from collections.abc import Mapping, Sequence
from math import nan
from typing import Final, Protocol

from adapters.mal import AttributeType, NamedValue, Typed
from adapters.mrs import types
from adapters.mrs.headers import to_ns
from executive.commands import Mode
from executive.commands.actions import HELP, offered
from executive.reports import Identity
from executive.runner import Executive
from executive.state import DEFINITIONS, Parameter, ParameterValue

FRAME: Final = "odom"

DEFINED: Final = tuple(
    types.ParameterDefinition(
        name=definition.parameter.value,
        description=definition.description,
        type=AttributeType.DOUBLE,
        unit=definition.unit,
        writable=definition.writable,
    )
    for definition in DEFINITIONS
)


class HasValues(Protocol):
    """Where the present values of all parameters are, in the order of their definition."""

    def values(self) -> Sequence[ParameterValue]:
        """Return them."""
        ...


class Asset(Protocol):
    """What knows the state of an asset: the executive aboard, or who hears its telemetry."""

    @property
    def status(self) -> HasValues:
        """The present values."""
        ...


def parameter_value(value: ParameterValue) -> types.ParameterValue:
    """Return a parameter value for the wire."""
    known = value.value is not None
    return types.ParameterValue(
        name=value.parameter.value,
        timestamp=to_ns(value.utc_s),
        validity=types.Validity.VALID if known else types.Validity.INVALID,
        value=Typed(AttributeType.DOUBLE, value.value) if known else None,
    )


def pose(asset: Asset) -> types.Pose:
    """Return where the rover is."""
    figure = figures(asset)
    return types.Pose(
        frame=FRAME,
        x=figure[Parameter.POS_X],
        y=figure[Parameter.POS_Y],
        z=figure[Parameter.POS_Z],
        heading=figure[Parameter.HEAD],
    )


def speeds(asset: Asset) -> types.Speeds:
    """Return how fast the rover may move, and does."""
    figure = figures(asset)
    return types.Speeds(
        travelSpeed=figure[Parameter.TRAVEL_SPEED],
        rotateSpeed=figure[Parameter.ROTATE_SPEED],
        currentTravelSpeed=figure[Parameter.CURRENT_TRAVEL_SPEED],
        currentRotateSpeed=figure[Parameter.CURRENT_ROTATE_SPEED],
    )


def camera_state(executive: Executive) -> types.CameraState:
    """Return where the camera points, and whether its video stream is forwarded."""
    figure, video = figures(executive), executive.context.video
    return types.CameraState(
        pan=figure[Parameter.CAM_PAN],
        tilt=figure[Parameter.CAM_TILT],
        rotateSpeed=figure[Parameter.CAM_ROTATE_SPEED],
        videoOn=video is not None and video.on,
    )


def actions(executive: Executive) -> tuple[NamedValue, ...]:
    """Return the text commands that there are, each with what it does."""
    return tuple(
        NamedValue(name=action.value, value=Typed(AttributeType.STRING, HELP[action]))
        for action in offered(executive.context.video)
    )


def asset_mode(mode: Mode) -> types.AssetMode:
    """Return the mode for the wire."""
    return types.AssetMode(mode.value)


def asset_info(executive: Executive, software: str) -> types.AssetInfo:
    """Return what the asset is, given the version of its software."""
    settings = executive.settings
    return types.AssetInfo(
        asset=settings.asset,
        domain=settings.domain,
        description=settings.description,
        softwareVersion=software,
        mode=asset_mode(executive.mode),
    )


def asset_status(executive: Executive) -> types.AssetStatus:
    """Return mode, work and all parameters."""
    values = executive.status.values()
    queues = (executive.context.motion, executive.context.camera)
    active = _active(executive)
    return types.AssetStatus(
        timestamp=to_ns(values[0].utc_s),
        mode=asset_mode(executive.mode),
        activeCommandId=active.command_id if active else None,
        queuedCommands=sum(len(queue) - (queue.active is not None) for queue in queues),
        activePlan=executive.context.agenda.executing,
        values=tuple(map(parameter_value, values)),
    )


def _active(executive: Executive) -> Identity | None:
    """The command under way: a stop before motion, motion before the camera's."""
    context = executive.context
    if context.latches.stopping:
        return context.latches.stopping[-1].command.identity
    goal = context.motion.active or context.camera.active
    return goal.command.identity if goal else None


def figures(asset: Asset) -> Mapping[Parameter, float]:
    """Return the present figures, NaN where they are not known."""
    return {
        value.parameter: nan if value.value is None else value.value
        for value in asset.status.values()
    }
