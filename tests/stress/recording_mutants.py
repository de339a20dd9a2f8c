"""Wrong recordings: damaged octets, changed content under a right checksum, hostile containers."""

import json
from collections.abc import Callable, Iterator
from contextlib import closing
from functools import cache
from io import BytesIO
from pathlib import Path
from random import Random
from struct import pack
from typing import Any, Final
from zlib import crc32

import zstandard
from mcap.records import Message
from mcap.stream_reader import StreamReader
from mcap.writer import Writer

from adapters.recording import PROFILE, RunFile
from adapters.recording.run_file import RUN
from executive.core.recording import Entry, Item
from sim.scenario.lockstep_run import run_in_lock_step
from sim.scenario.model import RunMode
from sim.scenario.reading import load_scenario
from tests.stress.fuzzing import mutate

Batch = dict[str, Any]
MAGIC: Final = b"\x89MCAP0\r\n"
CHUNK_S: Final = 0.2
"""Of the recordings that are changed: as a process that is flushed writes them."""
MIB: Final = 1 << 20

RUNS: Final = {
    "drive": """
title: A drive, a stop, a picture
duration: 1.1
timeline:
  - {at: 0.1, command: {moveForward: {distance: 2}}, label: ahead}
  - {at: 0.5, command: stop, label: stop}
  - {at: 0.6, command: resume, label: resume}
  - {at: 0.7, command: takePicture, label: picture}
expect: [{mode: IDLE}]
""",
    "plan": """
title: A plan, a kill and another start
duration: 1.2
timeline:
  - {at: 0.1, command: {submitPlan: {plan: look-around, id: tour}}, label: plan}
  - {after: plan EXECUTED, command: {activatePlan: {plan_id: tour}}, label: go}
  - {at: 0.6, crash: 0.2}
  - {at: 0.9, command: {moveTo: {x: 0.3, y: 0, heading: 0}}, label: to}
expect: [{mode: MOVING}]
""",
    "mocup": """
title: A rover that moves by itself
asset: mocup
duration: 1
timeline:
  - {at: 0.2, command: {moveForward: {distance: 0.1}}, label: ahead}
  - {at: 0.3, command: {rotateBy: {angle: 720deg}}, label: too-far}
expect: [{mode: IDLE}]
""",
}
ODD: Final[tuple[Any, ...]] = (
    *(
        None,
        True,
        False,
        -1,
        0,
        1,
        65_536,
        2**31,
        2**53 + 1,
        2**63,
        -(2**63),
        10**400,
        1_700_000_000,
    ),
    *(0.0, -0.0, 0.5, 1e-300, 1e9, 1e18, 1.8e308, float("nan"), float("inf")),
    *(
        "",
        "inf",
        "-inf",
        "nan",
        "1e400",
        "x",
        "x" * 20_000,
        "a\0b",
        "\ud800",
        "../../x",
        "/x",
        "⏚<b>&",
    ),
    *("MOE:1", "EXECUTED", "RUNNING", "MoveTo", "Odometry", "=" * 7, "AAAA"),
    *([], {}, [[]], [0.0] * 2000, ["inf"] * 400, {"kind": "Stop"}, [None], {"": {"": {}}}),
)
"""Values that take the place of others."""


class Flushed:
    """A tape whose file is flushed several times a second of the run."""

    def __init__(self, file: RunFile) -> None:
        self._file = file
        self._flushed_s = 0.0

    def put(self, item: Item) -> None:
        if isinstance(item, Entry) and abs(item.now_s - self._flushed_s) > CHUNK_S:
            self._flushed_s = item.now_s
            self._file.flush()
        self._file.put(item)


def originals(folder: Path) -> list[bytes]:
    """Return sound recordings: sensors and commands, a plan and a crash, another rover."""
    found = []
    for name, text in RUNS.items():
        scenario, path = folder / f"{name}.yaml", folder / f"{name}.mcap"
        scenario.write_text(text, encoding="utf-8")
        with closing(RunFile(path)) as file:
            run = load_scenario(str(scenario), RunMode.LOCK_STEP)
            run_in_lock_step(run, folder / name, Flushed(file))
        found.append(path.read_bytes())
    return found


def batches_of(octets: bytes) -> list[bytes]:
    """Return the batches of a recording."""
    records = StreamReader(BytesIO(octets)).records
    found = [each.data for each in records if isinstance(each, Message)]
    return [each for each in found if each.startswith(b'{"shapes":')]


def recording_of(batches: list[bytes]) -> bytes:
    """Return a recording of batches, each in a chunk of its own, with right checksums."""
    file = BytesIO()
    writer = Writer(file)
    writer.start(PROFILE, "rover-executive")
    run = writer.register_channel(RUN, "json", 0)
    for batch in batches:
        writer.add_message(run, 0, batch, 0)
        writer.flush()
    writer.finish()
    return file.getvalue()


class Mutants:
    """Makes wrong recordings, by the seed alone.

    Args:
        sound: the recordings that are changed.
    """

    def __init__(self, sound: list[bytes], seed: str) -> None:
        self._random = Random(seed)
        self._sound = sound
        self._batches = [batches_of(each) for each in sound]
        self._hostile = list(hostile(self._batches[0]))

    def next(self) -> tuple[str, bytes]:
        """Return the name of a change, and the recording with it."""
        random = self._random
        share = random.random()
        if share < 0.35:
            return self._damaged(random.choice(self._sound))
        batches = random.choice(self._batches)
        if share < 0.50:
            index = random.randrange(len(batches))
            changed = [*batches[:index], mutate(batches[index], random), *batches[index + 1 :]]
            return "content: text of a batch", recording_of(changed)
        if share < 0.97:
            names, parsed = [], [json.loads(each) for each in batches]
            for _ in range(random.choice((1, 1, 2, 4))):
                change = random.choice(CHANGES)
                change(parsed, random)
                names.append(change.__name__)
            return f"content: {', '.join(names)}", recording_of(
                [json.dumps(each).encode() for each in parsed]
            )
        name, make = random.choice(self._hostile)
        return name, make()

    def _damaged(self, octets: bytes) -> tuple[str, bytes]:
        random = self._random
        index, length = random.randrange(len(octets)), random.randrange(1, 5000)
        match random.randrange(6):
            case 0:
                return "cut off", octets[:index]
            case 1:
                return "zeros at the end", octets[:index] + bytes(length)
            case 2:
                return "zeros within", octets[:index] + bytes(length) + octets[index + length :]
            case 3:
                index = len(octets) - random.randrange(1, 3000)
                flipped = bytes([octets[index] ^ 1 << random.randrange(8)])
                return "a flipped bit at the end", octets[:index] + flipped + octets[index + 1 :]
            case _:
                return "changed octets", mutate(octets, random)


def _value(parsed: list[Batch], random: Random) -> None:
    """Put an odd value, or one of another place, into a row."""
    row = random.choice(random.choice(parsed)["rows"])
    other = random.choice(random.choice(parsed)["rows"])
    row[random.randrange(len(row))] = random.choice((*ODD, *other))


def _time(parsed: list[Batch], random: Random) -> None:
    """Have the times of an entry leap."""
    row = random.choice(random.choice(parsed)["rows"])
    by = random.choice((-1e10, -1e3, -0.01, 0.01, 10.0, 1e5, 1e8, 4e9, 1e12, 1e300))
    for index in range(1, min(3, len(row))):
        if isinstance(row[index], float):
            row[index] += by


def _inner(parsed: list[Batch], random: Random) -> None:
    """Put an odd value somewhere into the first row: the settings and the ledger."""
    part: Any = parsed[0]["rows"][0]
    while isinstance(part, list | dict) and part:
        keys = list(part) if isinstance(part, dict) else range(len(part))
        key = random.choice(keys)
        if not isinstance(part[key], list | dict) or random.random() < 0.1:
            part[key] = random.choice(ODD)
            return
        part = part[key]


def _name(parsed: list[Batch], random: Random) -> None:
    """Give a part of a message, or a topic, another name."""
    shapes = [shape for batch in parsed for shape in batch["shapes"]]
    shape, other = random.choice(shapes), random.choice(shapes)
    if random.random() < 0.3:
        shape[0] = random.choice((*ODD, other[0]))
    elif shape[1]:
        shape[1][random.randrange(len(shape[1]))] = random.choice((*ODD, *other[1], "x"))


def _rows(parsed: list[Batch], random: Random) -> None:
    """Drop, repeat, exchange or cut rows."""
    rows = random.choice(parsed)["rows"]
    index, other = random.randrange(len(rows)), random.randrange(len(rows))
    match random.randrange(5):
        case 0:
            del rows[index : index + random.randrange(1, 20)]
            rows.append([0])
        case 1:
            rows[index:index] = [list(rows[index]) for _ in range(random.randrange(1, 200))]
        case 2:
            rows[index], rows[other] = rows[other], rows[index]
        case 3:
            del rows[index][random.randrange(len(rows[index])) :]
            rows[index] = rows[index] or [0]
        case _:
            rows[index].append(random.choice(ODD))


def _batch(parsed: list[Batch], random: Random) -> None:
    """Drop, repeat or exchange batches, or their parts."""
    index, other = random.randrange(len(parsed)), random.randrange(len(parsed))
    match random.randrange(4):
        case 0 if len(parsed) > 1:
            del parsed[index]
        case 1:
            parsed.insert(index, json.loads(json.dumps(parsed[index])))
        case 2:
            parsed[index], parsed[other] = parsed[other], parsed[index]
        case _:
            parsed[index]["shapes"] = parsed[other]["shapes"]


CHANGES: Final = (_value, _value, _value, _time, _inner, _name, _rows, _batch)


def record(opcode: int, content: bytes) -> bytes:
    """Return a record of an MCAP file."""
    return pack("<BQ", opcode, len(content)) + content


def text(value: str) -> bytes:
    """Return a text as MCAP has it."""
    return pack("<I", len(value)) + value.encode()


def chunk(
    data: bytes, claimed: int | None = None, how: str = "zstd", crc: int | None = None
) -> bytes:
    """Return a chunk, which may lie about what it unpacks to."""
    packed = zstandard.compress(data) if how == "zstd" else data
    size = len(data) if claimed is None else claimed
    head = pack("<QQQI", 0, 0, size, crc32(data) if crc is None else crc)
    return record(6, head + text(how) + pack("<Q", len(packed)) + packed)


def container(*records: bytes, profile: str = PROFILE) -> bytes:
    """Return an MCAP file of these records."""
    end = record(0x0F, bytes(4)) + record(2, bytes(20)) + MAGIC
    return MAGIC + record(1, text(profile) + text("")) + b"".join(records) + end


def message(batch: bytes) -> bytes:
    """Return what a chunk with one batch unpacks to."""
    channel = pack("<HH", 1, 0) + text(RUN) + text("json") + bytes(4)
    return record(4, channel) + record(5, pack("<HIQQ", 1, 0, 0, 0) + batch)


def bomb(mib: int, claimed: int) -> bytes:
    """Return a recording whose one chunk unpacks to MiB of zeros, and claims another size."""
    packed = _packed_zeros(mib)
    head = pack("<QQQI", 0, 0, claimed, 0) + text("zstd") + pack("<Q", len(packed)) + packed
    return container(record(6, head))


@cache
def _packed_zeros(mib: int) -> bytes:
    packer = zstandard.ZstdCompressor().compressobj(size=mib * MIB)
    return b"".join(packer.compress(bytes(MIB)) for _ in range(mib)) + packer.flush()


def hostile(batches: list[bytes]) -> Iterator[tuple[str, Callable[[], bytes]]]:
    """Yield names of recordings made on purpose, with what makes them."""
    first, second = batches[0], json.loads(batches[1])
    start = chunk(message(first))

    def behind(batch: bytes) -> bytes:
        return container(start, chunk(message(batch)))

    def of_rows(found: list[Any]) -> bytes:
        return behind(json.dumps({"shapes": second["shapes"], "rows": found}).encode())

    large, honest = bomb(1024, 1000), bomb(1024, 1024 * MIB)
    yield "content: a bomb that claims 1000 octets", lambda: large
    yield "content: a bomb that claims its size", lambda: honest
    yield "content: a bomb of the budget", lambda: bomb(4, 4 * MIB)
    yield "content: a bomb behind a life", lambda: container(start, chunk(bytes(200 * MIB), 1000))
    yield (
        "content: many chunks of zeros",
        lambda: container(start, *[chunk(record(0, bytes(MIB)))] * 300),
    )
    yield "content: many chunks of nothing", lambda: container(start, *[chunk(b"")] * 20_000)
    yield "content: many records", lambda: container(start, chunk(record(3, b"") * 400_000))
    yield "content: many messages", lambda: container(start, chunk(record(5, bytes(22)) * 120_000))
    yield (
        "content: a batch of blanks",
        lambda: behind(b'{"shapes":[],"rows":[' + b" " * 3 * MIB + b"]}"),
    )
    yield (
        "content: a batch of lists",
        lambda: behind(b'{"shapes":[],"rows":[' + b"[]," * MIB + b"[]]}"),
    )
    yield (
        "content: a batch of objects",
        lambda: behind(b'{"shapes":[],"rows":[' + b"{}," * 160_000 + b"1]}"),
    )
    yield "content: lists in lists", lambda: behind(b'{"shapes":[],"rows":[' + b"[" * 100_000)
    deep = b"[" * 900 + b"]" * 900
    yield (
        "content: deep values",
        lambda: behind(b'{"shapes":[],"rows":[[1,1.0,1.0,' + deep + b"]]}"),
    )
    named = b'["a",' * 400 + b'["b"]' + b"]" * 400
    yield (
        "content: deep names",
        lambda: behind(b'{"shapes":[["/in/tick",[' + named + b']]],"rows":[]}'),
    )
    yield (
        "content: a number of 200,000 digits",
        lambda: behind(b'{"shapes":[],"rows":[[' + b"1" * 200_000),
    )
    yield "content: a text of 3 MiB", lambda: of_rows([[0, "x" * 3 * MIB]])
    yield "content: rows 5 times", lambda: of_rows(second["rows"] * 5)
    yield "content: rows 2000 times", lambda: of_rows(second["rows"] * 2000)
    ticks = [row for row in second["rows"] if len(row) == 3] * 10_000
    yield "content: many ticks", lambda: of_rows(ticks)
    yield "content: UTF-16", lambda: behind(batches[1].decode().encode("utf-16"))
    yield "content: another profile", lambda: container(start, profile="rover-run-1")
    yield "content: lz4", lambda: container(start, chunk(message(batches[1]), how="lz4"))
    yield "content: not packed", lambda: container(start, chunk(message(batches[1]), how=""))
    yield "content: a wrong checksum", lambda: container(start, chunk(message(batches[1]), crc=1))
    yield (
        "content: a length of 2^64",
        lambda: container(start)[:-30] + pack("<BQ", 6, 2**64 - 1) + bytes(99),
    )
    yield (
        "content: a long attachment",
        lambda: container(start, record(9, bytes(9 * MIB)), chunk(b"")),
    )
    yield (
        "content: a long index",
        lambda: container(start, record(7, pack("<HI", 0, 16 << 20) + bytes(16 << 20))),
    )
