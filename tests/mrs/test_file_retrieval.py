"""Fetching a file over a link that is cut again and again."""

import asyncio
import random
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, suppress
from itertools import chain, repeat
from pathlib import Path
from zlib import crc32

import pytest

from adapters.mal import Encoding, MalError, MalUri
from adapters.mrs.ground import MrsClient, TransferError
from adapters.mrs.spec import FileEventType
from adapters.mrs.transport import TransportSettings
from executive.commands import DeleteFile, MoveFile, TakePicture
from tests.mrs.aboard import Aboard, raises
from tests.support.certificates import make_ends
from tests.support.kinematic import PICTURE


class Cutting:
    """Passes octets on, and cuts its connections one after the other.

    Attributes:
        cuts: how many connections it has cut.
    """

    def __init__(self, to: MalUri, budgets: Iterator[int | None]) -> None:
        self._to = to
        self._budgets = budgets
        self._passing: set[asyncio.Task[None]] = set()
        self.cuts = 0

    def pass_on(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Take a connection."""
        self._passing.add(asyncio.create_task(self._pass_on(reader, writer)))

    async def end(self) -> None:
        """Return when all connections have ended."""
        await asyncio.gather(*self._passing)

    async def _pass_on(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            there, back = await asyncio.open_connection(self._to.host, self._to.port)
        except ConnectionError:
            writer.transport.abort()
            return
        routes = [
            asyncio.create_task(self._pump(reader, back, None)),
            asyncio.create_task(self._pump(there, writer, next(self._budgets))),
        ]
        await asyncio.wait(routes, return_when=asyncio.FIRST_COMPLETED)
        for path in routes:
            path.cancel()
        await asyncio.gather(*routes, return_exceptions=True)
        for end in (writer, back):
            end.transport.abort()
            with suppress(ConnectionError):
                await end.wait_closed()

    async def _pump(
        self, source: asyncio.StreamReader, sink: asyncio.StreamWriter, budget: int | None
    ) -> None:
        try:
            while octets := await source.read(1 << 16):
                if budget is not None and len(octets) >= budget:
                    sink.write(octets[:budget])
                    await sink.drain()
                    self.cuts += 1
                    return
                budget = None if budget is None else budget - len(octets)
                sink.write(octets)
                await sink.drain()
        except ConnectionError:
            return


@asynccontextmanager
async def cutting(uri: str, budgets: Iterator[int | None]) -> AsyncIterator[tuple[str, Cutting]]:
    """Give the address of a link that is cut, and what cuts it."""
    proxy = Cutting(MalUri.parse(uri), budgets)
    server = await asyncio.start_server(proxy.pass_on, "127.0.0.1", 0)
    port = server.sockets[0].getsockname()[1]
    try:
        yield f"127.0.0.1:{port}", proxy
    finally:
        server.close()
        await server.wait_closed()
        await proxy.end()


OCTETS = random.Random(7).randbytes(3_000_001)


def part_of(to: Path, octets: bytes) -> Path:
    return to.with_name(f"{to.name}.{crc32(octets):08x}.part")


async def test_a_file_is_fetched_whole(aboard: Aboard, tmp_path: Path, client: MrsClient) -> None:
    aboard.put("a/rock.jpg", OCTETS)
    reported: list[tuple[int, int]] = []
    to = tmp_path / "here" / "rock.jpg"

    file = await client.retrieve_file("a/rock.jpg", to, lambda *at: reported.append(at))
    assert (file.size, file.checksum) == (len(OCTETS), crc32(OCTETS))
    assert to.read_bytes() == OCTETS
    assert reported == sorted(reported)
    assert (reported[0], reported[-1]) == ((0, len(OCTETS)), (len(OCTETS), len(OCTETS)))
    assert [path.name for path in to.parent.iterdir()] == ["rock.jpg"]


def test_an_empty_file_is_fetched(aboard: Aboard, tmp_path: Path) -> None:
    aboard.put("empty", b"")
    aboard.ground(lambda client: client.retrieve_file("empty", tmp_path / "empty"))
    assert (tmp_path / "empty").read_bytes() == b""


@pytest.mark.parametrize("encoding", list(Encoding))
@pytest.mark.parametrize("secured", [False, True], ids=["clear", "TLS"])
def test_a_file_is_fetched_on_the_terms_of_the_link(
    tmp_path: Path, encoding: Encoding, secured: bool
) -> None:
    ends = make_ends(tmp_path) if secured else None
    ours = TransportSettings(encoding, None if ends is None else ends.ground)
    rover = Aboard(
        tmp_path, terms=TransportSettings(encoding, None if ends is None else ends.rover)
    )
    to = tmp_path / "rock.jpg"

    async def session() -> None:
        async with await MrsClient.connect(rover.uri, terms=ours) as client:
            updates = await client.file_events()
            await client.retrieve_file("rock.jpg", to)
            events = [(await anext(updates)).event]
            while events[-1] is not FileEventType.TRANSFERRED:
                events.append((await anext(updates)).event)
            assert set(events[:-1]) <= {FileEventType.STORED}  # told late

    try:
        rover.put("rock.jpg", OCTETS)
        asyncio.run(session())
    finally:
        rover.close()
    assert to.read_bytes() == OCTETS


@pytest.mark.parametrize("seed", range(6))
def test_a_cut_link_costs_nothing_but_the_rest(aboard: Aboard, tmp_path: Path, seed: int) -> None:
    aboard.put("rock.jpg", OCTETS)
    dice = random.Random(seed)
    budgets = [dice.randrange(1, 1_500_000) for _ in range(dice.randrange(1, 6))]
    progress: list[int] = []
    to = tmp_path / "rock.jpg"

    async def session() -> int:
        link = chain([None], budgets, repeat(None))
        async with (
            cutting(aboard.uri, link) as (address, proxy),
            await MrsClient.connect(address) as client,
        ):
            await client.retrieve_file("rock.jpg", to, lambda done, _: progress.append(done))
            return proxy.cuts

    assert asyncio.run(session()) >= 1
    assert to.read_bytes() == OCTETS
    assert progress == sorted(progress), "nothing that was here came again"


async def test_an_interrupted_transfer_continues_later(
    aboard: Aboard, tmp_path: Path, client: MrsClient
) -> None:
    aboard.put("rock.jpg", OCTETS)
    to = tmp_path / "rock.jpg"
    part_of(to, OCTETS).write_bytes(OCTETS[:1_000_000])
    progress: list[int] = []

    await client.retrieve_file("rock.jpg", to, lambda done, _: progress.append(done))
    assert progress[0] == 1_000_000
    assert to.read_bytes() == OCTETS


def test_a_part_that_is_wrong_is_noticed_and_thrown_away(aboard: Aboard, tmp_path: Path) -> None:
    aboard.put("rock.jpg", OCTETS)
    to = tmp_path / "rock.jpg"
    part = part_of(to, OCTETS)
    part.write_bytes(b"x" * 1000)
    with pytest.raises(TransferError, match="CRC-32"):
        aboard.ground(lambda client: client.retrieve_file("rock.jpg", to))
    assert list(tmp_path.glob("rock.jpg*")) == []
    part.write_bytes(OCTETS + b"more")
    aboard.ground(lambda client: client.retrieve_file("rock.jpg", to))
    assert to.read_bytes() == OCTETS


def test_a_file_changed_between_two_attempts_is_not_mixed(aboard: Aboard, tmp_path: Path) -> None:
    path = aboard.put("rock.jpg", OCTETS)
    to = tmp_path / "rock.jpg"

    def change(done: int, _: int) -> None:
        if 0 < done < len(OCTETS) // 2:
            path.write_bytes(OCTETS[::-1])

    async def session() -> None:
        link = chain([None, 1_000_000], repeat(None))
        async with (
            cutting(aboard.uri, link) as (address, _),
            await MrsClient.connect(address) as client,
        ):
            await client.retrieve_file("rock.jpg", to, change)

    with pytest.raises((TransferError, MalError), match="changed"):
        asyncio.run(session())
    assert not to.exists()
    aboard.ground(lambda client: client.retrieve_file("rock.jpg", to))
    assert to.read_bytes() == OCTETS[::-1]


def test_an_absent_file_cannot_be_fetched(aboard: Aboard, tmp_path: Path) -> None:
    for path in ("nothing.jpg", "../ledger.sqlite", "a//b"):
        with raises(5):
            aboard.ground(lambda client, path=path: client.retrieve_file(path, tmp_path / "x"))  # type: ignore[misc]
    assert not list(tmp_path.glob("x*"))


def test_a_picture_shows_up_by_itself_and_goes(aboard: Aboard) -> None:
    aboard.runs = True

    async def session() -> list[tuple[FileEventType, str]]:
        async with await MrsClient.connect(aboard.uri) as client:
            updates = await client.file_events()
            picture = client.command(TakePicture(), command_id=7)
            assert (await client.run(picture)).executed
            (stored,) = [await anext(updates)]
            assert {known.name for known in stored.file.metaData or ()} > {"commandId", "POS_X"}
            path = stored.file.path
            assert await client.list_files() == await client.list_files("pictures")
            assert [file.path for file in await client.list_files()] == [path]
            file = await client.get_attributes(path)
            assert file.checksum == crc32(PICTURE)
            assert file.mimeType == "image/jpeg"
            assert (await client.run(client.command(MoveFile(path, "kept/a.jpg")))).executed
            assert (await client.run(client.command(DeleteFile("kept/a.jpg")))).executed
            rest = [await anext(updates) for _ in range(3)]
            assert await client.list_files() == ()
            return [(each.event, each.file.path) for each in (stored, *rest)]

    assert asyncio.run(session()) == [
        (FileEventType.STORED, "pictures/MOE-7.jpg"),
        (FileEventType.DELETED, "pictures/MOE-7.jpg"),
        (FileEventType.STORED, "kept/a.jpg"),
        (FileEventType.DELETED, "kept/a.jpg"),
    ]


def test_file_events_arrive_again_after_a_loss(aboard: Aboard) -> None:
    aboard.runs = True

    async def session() -> str:
        async with await MrsClient.connect(aboard.uri) as client:
            updates = await client.file_events()
            await asyncio.to_thread(aboard.hang_up)
            await asyncio.to_thread(aboard.listen)
            assert (await client.run(client.command(TakePicture(), command_id=8))).executed
            return (await anext(updates)).file.path

    assert asyncio.run(session()) == "pictures/MOE-8.jpg"
