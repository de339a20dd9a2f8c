"""What is told of a file aboard: `FileInfo`."""

from typing import Final

from adapters.mal import AttributeType, NamedValue, Typed
from adapters.mrs.types import FileInfo
from executive.reasons import Figure
from executive.state import FileFolder, FileStamp

UNKNOWN_KIND: Final = "application/octet-stream"
KINDS: Final = {
    "avi": "video/x-msvideo",
    "bmp": "image/bmp",
    "csv": "text/csv",
    "gz": "application/gzip",
    "jpeg": "image/jpeg",
    "jpg": "image/jpeg",
    "json": "application/json",
    "log": "text/plain",
    "mp4": "video/mp4",
    "pdf": "application/pdf",
    "pgm": "image/x-portable-graymap",
    "png": "image/png",
    "ppm": "image/x-portable-pixmap",
    "tif": "image/tiff",
    "tiff": "image/tiff",
    "txt": "text/plain",
    "xml": "application/xml",
    "yaml": "application/yaml",
    "zip": "application/zip",
}
"""Media types by suffix. Python's own table depends on the machine, and takes memory."""


def mime_type(path: str) -> str:
    """Return the media type that a file's name tells."""
    return KINDS.get(path.rpartition(".")[2].lower(), UNKNOWN_KIND)


def file_info(
    path: str,
    stamp: FileStamp,
    checksum: int | None = None,
    meta_data: tuple[NamedValue, ...] | None = None,
) -> FileInfo:
    """Return what is told of a file."""
    return FileInfo(
        path=path,
        size=stamp.size_octets,
        modified=stamp.modified_ns,
        mimeType=mime_type(path),
        checksum=checksum,
        metaData=meta_data,
    )


def meta_data(folder: FileFolder, path: str) -> tuple[NamedValue, ...] | None:
    """Return what is known about a file beside its content; reads a file."""
    return tuple(map(_named, folder.about(path))) or None


def _named(figure: Figure) -> NamedValue:
    if isinstance(figure.value, int):
        return NamedValue(name=figure.name, value=Typed(AttributeType.LONG, figure.value))
    return NamedValue(name=figure.name, value=Typed(AttributeType.DOUBLE, float(figure.value)))
