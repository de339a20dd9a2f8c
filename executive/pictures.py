"""How a picture is stored aboard: its name, and what is kept about it."""

from hashlib import sha256
from typing import Final

from executive.facts import Frame
from executive.files import FileFolder
from executive.parameters import Parameter, ParameterValue
from executive.reasons import Figure
from executive.reports import Identity

FOLDER: Final = "pictures"
LONGEST_NAME: Final = 64
TELLING: Final = {
    Parameter.POS_X: "m",
    Parameter.POS_Y: "m",
    Parameter.POS_Z: "m",
    Parameter.HEAD: "rad",
    Parameter.CAM_PAN: "rad",
    Parameter.CAM_TILT: "rad",
}
"""The parameters that are kept with a picture, with their units."""


def store_picture(
    files: FileFolder, frame: Frame, identity: Identity, values: tuple[ParameterValue, ...]
) -> str:
    """Store a camera frame under the name of the command that asked for it.

    Args:
        files: where to.
        frame: the picture.
        identity: of the command.
        values: the parameters when it was taken.

    Returns:
        Its path in the folder.

    Raises:
        OSError: the file cannot be written.
    """
    name = f"{_file_name(identity.source)}-{identity.command_id}.{frame.format.lower()}"
    about = [Figure("commandId", identity.command_id)]
    about += [
        Figure(value.parameter.value, value.value, TELLING[value.parameter])
        for value in values
        if value.parameter in TELLING and value.value is not None
    ]
    path = f"{FOLDER}/{name}"
    files.store(path, frame.data, tuple(about))
    return path


def _file_name(source: str) -> str:
    """Return a short name for a file, no two sources' alike."""
    name = "".join(c if c.isascii() and (c.isalnum() or c in "-_") else "_" for c in source)
    name = name[:LONGEST_NAME]
    return name if name == source else f"{name}-{sha256(source.encode()).hexdigest()[:12]}"
