"""Completes recordings that broke off, so that viewers open them: they want an index at the end.

What is torn at the end is cut off; what can be read stays as it is. A record says that the
recording broke off, which a reader tells.
"""

import os
import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Final

from adapters.recording.run_file import BROKE_OFF, LARGEST_RECORD

if TYPE_CHECKING:
    from mcap.records import Channel, ChunkIndex, Schema

_MAGIC: Final = b"\x89MCAP0\r\n"
_FRAME: Final = struct.Struct("<BQ")
"""Of a record: what it is, and how many octets follow."""
_MESSAGE: Final = struct.Struct("<HIQ")
"""The beginning of a message: channel, sequence, time."""


@dataclass(slots=True)
class _Found:
    """What is in the sound part of a file.

    Attributes:
        end: where the last whole chunk ends.
        last: the messages of that chunk: times and places, by channel.
    """

    end: int
    schemas: "dict[int, Schema]" = field(default_factory=dict)
    channels: "dict[int, Channel]" = field(default_factory=dict)
    chunks: "list[ChunkIndex]" = field(default_factory=list)
    counts: Counter[int] = field(default_factory=Counter)
    last: dict[int, list[tuple[int, int]]] = field(default_factory=dict)


def complete(path: Path) -> bool:
    """Complete a recording that broke off; return whether it had.

    Raises:
        OSError: the file cannot be read or written.
    """
    times = path.stat()
    with path.open("r+b") as file:
        if file.read(len(_MAGIC)) != _MAGIC:
            return False
        file.seek(max(len(_MAGIC), times.st_size - len(_MAGIC)))
        if file.read() == _MAGIC:
            return False
        file.seek(len(_MAGIC))
        found = _sound_part(file)
        file.seek(found.end)
        file.truncate()
        _write_end(file, found)
    os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))  # the oldest are deleted first
    return True


def _sound_part(file: IO[bytes]) -> _Found:
    from mcap.data_stream import ReadDataStream
    from mcap.exceptions import McapError
    from mcap.opcode import Opcode
    from mcap.records import Chunk, ChunkIndex, MessageIndex
    from zstandard import ZstdError

    found = _Found(file.tell())
    try:
        for start, opcode, content in _records(file):
            end = start + _FRAME.size + len(content)
            stream = ReadDataStream(BytesIO(content))
            match opcode:
                case Opcode.HEADER:
                    found.end = end
                case Opcode.CHUNK:
                    chunk = Chunk.read(stream)
                    found.last = _take(chunk, found)
                    found.end = end
                    found.chunks.append(
                        ChunkIndex(
                            chunk_length=end - start,
                            chunk_start_offset=start,
                            compression=chunk.compression,
                            compressed_size=len(chunk.data),
                            message_end_time=chunk.message_end_time,
                            message_index_length=0,
                            message_index_offsets={},
                            message_start_time=chunk.message_start_time,
                            uncompressed_size=chunk.uncompressed_size,
                        )
                    )
                case Opcode.MESSAGE_INDEX:
                    index = MessageIndex.read(stream)
                    found.chunks[-1].message_index_offsets[index.channel_id] = start
                    found.chunks[-1].message_index_length += end - start
                case _:
                    break  # of an end that was torn while it was written
    except (McapError, ZstdError, struct.error, ValueError, LookupError):
        pass  # what is behind the last whole chunk is torn
    return found


def _records(file: IO[bytes]) -> Iterator[tuple[int, int, bytes]]:
    """Yield place, kind and content of the records, as far as they are whole."""
    while True:
        start = file.tell()
        frame = file.read(_FRAME.size)
        if len(frame) < _FRAME.size:
            return
        opcode, length = _FRAME.unpack(frame)
        content = file.read(min(length, LARGEST_RECORD))
        if len(content) < length:
            return
        yield start, opcode, content


def _take(chunk: Any, found: _Found) -> dict[int, list[tuple[int, int]]]:
    """Take in what a chunk holds, and return its messages: times and places, by channel."""
    from mcap.data_stream import ReadDataStream
    from mcap.opcode import Opcode
    from mcap.records import Channel, Schema
    from mcap.stream_reader import get_chunk_data_stream

    stream, length = get_chunk_data_stream(chunk, validate_crc=True)
    messages: dict[int, list[tuple[int, int]]] = {}
    while (place := stream.count) < length:
        opcode, size = _FRAME.unpack(stream.read(_FRAME.size))
        content = stream.read(size)
        match opcode:
            case Opcode.SCHEMA:
                schema = Schema.read(ReadDataStream(BytesIO(content)))
                found.schemas[schema.id] = schema
            case Opcode.CHANNEL:
                channel = Channel.read(ReadDataStream(BytesIO(content)))
                found.channels[channel.id] = channel
            case Opcode.MESSAGE:
                number, _, time_ns = _MESSAGE.unpack_from(content)
                messages.setdefault(number, []).append((time_ns, place))
            case _:
                pass
    found.counts.update({number: len(each) for number, each in messages.items()})
    return messages


def _write_end(file: IO[bytes], found: _Found) -> None:
    """Write the index of the last chunk anew, for it may be torn, and then what ends a file."""
    from mcap.data_stream import RecordBuilder
    from mcap.records import DataEnd, Footer, MessageIndex, Metadata, Statistics

    out = RecordBuilder()
    if found.chunks:
        last = found.chunks[-1]
        last.message_index_offsets.clear()
        for number, messages in found.last.items():
            last.message_index_offsets[number] = found.end + out.count
            MessageIndex(channel_id=number, records=messages).write(out)
        last.message_index_length = out.count
    Metadata(name=BROKE_OFF, metadata={}).write(out)
    DataEnd(data_section_crc=0).write(out)
    summary = found.end + out.count
    for each in (*found.schemas.values(), *found.channels.values()):
        each.write(out)
    Statistics(
        attachment_count=0,
        channel_count=len(found.channels),
        channel_message_counts=dict(found.counts),
        chunk_count=len(found.chunks),
        message_count=found.counts.total(),
        message_end_time=max((each.message_end_time for each in found.chunks), default=0),
        message_start_time=min((each.message_start_time for each in found.chunks), default=0),
        metadata_count=1,
        schema_count=len(found.schemas),
    ).write(out)
    for chunk in found.chunks:
        chunk.write(out)
    Footer(summary_start=summary, summary_offset_start=0, summary_crc=0).write(out)
    file.write(out.end() + _MAGIC)
