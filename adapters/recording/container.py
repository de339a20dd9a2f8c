"""`read_records`: the records of an MCAP file, read within bounds up to the first damage.

The package `mcap` decodes the content of records. This module limits the size of records and the
unpacked size of chunks: lengths in a file are not trusted.
"""

import os
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from typing import IO, Any, Final

MAGIC: Final = b"\x89MCAP0\r\n"
MAX_RECORD_OCTETS: Final = 1 << 28
"""Ten times the maximum size of a message, the image of a ledger of 100,000 reports (21 MB)."""
MAX_SMALL_OCTETS: Final = 1 << 20
"""Maximum size of a record that is not a chunk."""
MIN_BUDGET_OCTETS: Final = 1 << 22
"""Unpacked size allowed for any file and any chunk: four times that of a chunk written here."""
MAX_CHUNK_RATIO: Final = 16
"""Maximum compression ratio of a chunk beyond that; a ledger image has 10 (measured)."""
MAX_RATIO: Final = 1000
"""The same for a file. Measured: 3 with noise, 105 for a laser without returns; can be 30,000."""
SCHEMA, CHANNEL, MESSAGE = 3, 4, 5
HEADER, CHUNK, INDEX, ATTACHMENT, METADATA, DATA_END = 1, 6, 7, 9, 12, 15
"""Opcodes of records: those within chunks, and those beside them up to the summary."""
_FRAME: Final = struct.Struct("<BQ")
"""Head of a record: opcode, and number of octets that follow."""


class RecordingError(Exception):
    """A file cannot be used as a recording; the text gives the reason."""


class DamageError(Exception):
    """A file cannot be read beyond this point; the text gives the reason."""


@contextmanager
def damage_in(what: str) -> Iterator[None]:
    """Convert exceptions that parsers raise on untrusted octets to DamageError."""
    from mcap.exceptions import McapError
    from zstandard import ZstdError

    errors = (McapError, ZstdError, struct.error, LookupError, TypeError, ValueError)
    try:
        yield
    except (*errors, OverflowError, MemoryError, RecursionError) as error:
        raise DamageError(f"{what}: {error}") from error


@dataclass(frozen=True, slots=True)
class Record:
    """A record of a file or a chunk; `start` is its offset there."""

    start: int
    opcode: int
    content: bytes

    @property
    def channel(self) -> int:
        """Channel id of a message."""
        return int.from_bytes(self.content[:2], "little")

    def parsed(self, kind: Any, *length: int) -> Any:
        """Return the record decoded as a class of `mcap.records`; a message needs its length.

        Raises:
            DamageError: the record does not have this type.
        """
        from mcap.data_stream import ReadDataStream

        with damage_in(f"the record at octet {self.start}"):
            stream = ReadDataStream(BytesIO(self.content))
            record = kind.read(stream, *length)
            if stream.count != len(self.content):
                raise ValueError(f"{stream.count} of {len(self.content)} octets belong to it")
            return record


def read_records(file: IO[bytes]) -> Iterator[Record]:
    """Yield the complete records of a file's data section, except attachments.

    The last one ends the data section. The summary behind it only repeats earlier content.

    Raises:
        DamageError: octets that are not a record.
    """
    size = os.fstat(file.fileno()).st_size
    if not MAGIC.startswith(file.read(len(MAGIC))):
        raise DamageError("it does not begin with the MCAP magic")
    start, opcode = len(MAGIC), 0
    while opcode != DATA_END and start + _FRAME.size <= size:
        opcode, length = _FRAME.unpack(file.read(_FRAME.size))
        is_small = opcode in {HEADER, INDEX, METADATA, DATA_END}
        limit = MAX_SMALL_OCTETS if is_small else MAX_RECORD_OCTETS
        if not (is_small or opcode in {CHUNK, ATTACHMENT}) or length > limit:
            raise DamageError(f"no record begins at octet {start}")
        end = start + _FRAME.size + length
        if end > size:
            return
        if opcode == ATTACHMENT:
            file.seek(end)
        else:
            content = file.read(length)
            if opcode == INDEX and int.from_bytes(content[2:6], "little") != length - 6:
                raise DamageError(f"at octet {start} is no index")  # but perhaps a chunk
            yield Record(start, opcode, content)
        start = end


class Unpacker:
    """Unpacks the chunks of one file in order, within bounds.

    Attributes:
        packed: packed octets of all chunks read.
    """

    def __init__(self) -> None:
        self.packed = self._unpacked = 0

    def records(self, chunk: Record) -> Iterator[Record]:
        """Yield the schemas, channels and messages of a chunk.

        Raises:
            DamageError: not a chunk, too large, wrong checksum, or other records in it.
        """
        data, end = self._unpack(chunk), 0
        while (start := end) < len(data):
            head = data[start : start + _FRAME.size]
            opcode, length = _FRAME.unpack(head.ljust(_FRAME.size, b"\0"))
            end = start + _FRAME.size + length
            if end > len(data) or opcode not in {SCHEMA, CHANNEL, MESSAGE}:
                raise DamageError(f"no record begins at octet {start} of a chunk")
            yield Record(start, opcode, data[start + _FRAME.size : end])

    def _unpack(self, record: Record) -> bytes:
        from mcap.records import Chunk
        from zstandard import ZstdDecompressor

        chunk, where = record.parsed(Chunk), f"the chunk at octet {record.start}"
        size: int = chunk.uncompressed_size
        data: bytes = chunk.data
        self.packed += len(data)
        self._unpacked += size
        is_too_large = size > MIN_BUDGET_OCTETS + MAX_CHUNK_RATIO * len(data)
        if is_too_large or self._unpacked > MIN_BUDGET_OCTETS + MAX_RATIO * self.packed:
            raise DamageError(f"{where} unpacks {len(data)} octets to {size}, beyond the limit")
        if chunk.compression == "zstd":
            with damage_in(where), ZstdDecompressor().stream_reader(data) as stream:
                data = stream.read(size + 1)
        elif chunk.compression:
            raise DamageError(f"{where} is packed by {chunk.compression[:16]!r}, not by zstd")
        if len(data) != size or chunk.uncompressed_crc not in {0, zlib.crc32(data)}:
            raise DamageError(f"{where} fails its checksum")
        return data
