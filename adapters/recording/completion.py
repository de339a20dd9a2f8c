"""`complete` adds to a truncated recording the index at its end, which viewers need.

An incomplete end is removed; readable content stays unchanged. A metadata record marks the
recording as truncated, for readers.
"""

import os
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

from adapters.recording.container import (
    CHANNEL,
    CHUNK,
    HEADER,
    MAGIC,
    SCHEMA,
    DamageError,
    Record,
    Unpacker,
    read_records,
)
from adapters.recording.run_file import LIBRARY, PROFILE, TRUNCATED


def complete(path: Path) -> bool:
    """Complete a recording if it is truncated; return whether it was.

    A recording with sound parts behind a damaged one is left unchanged.

    Raises:
        OSError: the file cannot be read or written.
    """
    times, whole = path.stat(), path.with_suffix(".whole")
    with path.open("rb") as torn:
        head = torn.read(len(MAGIC))
        torn.seek(max(len(MAGIC), times.st_size - len(MAGIC)))
        if head != MAGIC or torn.read() == MAGIC:
            return False
        torn.seek(0)
        try:
            with whole.open("wb") as file:
                is_copied = _copy(torn, file)
            if is_copied:
                os.utime(whole, ns=(times.st_atime_ns, times.st_mtime_ns))  # pruned by this time
                whole.replace(path)
            return is_copied
        finally:
            whole.unlink(missing_ok=True)


def _copy(torn: IO[bytes], file: IO[bytes]) -> bool:
    """Copy everything before the truncated end, with an index; return False if more is lost."""
    from mcap.writer import Writer

    writer, unpacker, is_damaged = Writer(file), Unpacker(), False
    writer.start(_profile_of(torn), LIBRARY)
    schemas, channels = {0: 0}, dict[int, int]()
    with suppress(DamageError):  # the end behind the last complete record
        for chunk in read_records(torn):
            if chunk.opcode != CHUNK:
                continue
            try:
                records = list(unpacker.records(chunk))
            except DamageError:
                is_damaged = True
                continue
            if is_damaged:
                return False
            for record in records:
                _write(record, writer, schemas, channels)
    writer.flush()
    writer.add_metadata(TRUNCATED, {})
    writer.finish()
    return True


def _profile_of(torn: IO[bytes]) -> str:
    """Return the profile, which may be of another version; ours if the header is incomplete."""
    from mcap.records import Header

    profile = PROFILE
    with suppress(DamageError):
        first = next(read_records(torn), None)
        if first is not None and first.opcode == HEADER:
            profile = first.parsed(Header).profile
    torn.seek(0)
    return profile


def _write(record: Record, writer: Any, schemas: dict[int, int], channels: dict[int, int]) -> None:
    """Write a record of a chunk; its schema and channel get new ids."""
    from mcap.records import Channel, Message, Schema

    if record.opcode == SCHEMA:
        schema = record.parsed(Schema)
        schemas[schema.id] = writer.register_schema(schema.name, schema.encoding, schema.data)
    elif record.opcode == CHANNEL:
        channel = record.parsed(Channel)
        channels[channel.id] = writer.register_channel(
            channel.topic, channel.message_encoding, schemas.get(channel.schema_id, 0)
        )
    else:
        it = record.parsed(Message, len(record.content))
        if it.channel_id in channels:
            number = channels[it.channel_id]
            writer.add_message(number, it.log_time, it.data, it.publish_time, it.sequence)
