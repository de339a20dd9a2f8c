"""`rover files`: list, describe, fetch and watch the files of a rover."""

import asyncio
import sys
from collections.abc import Coroutine
from datetime import UTC, datetime
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any, Final

import click

from adapters.mrs.cli.sending import FAILED, connect
from adapters.mrs.cli.target import Target, to_option

if TYPE_CHECKING:
    from rich.table import Table

    from adapters.mrs.ground import MrsClient
    from adapters.mrs.spec import FileInfo

LARGEST_CHUNK: Final = 1 << 18


@click.group()
def files() -> None:
    """List, describe, fetch and watch the files of a rover.

    To delete or move one is a command: rover command deleteFile, rover command moveFile.

    \b
    Examples:
      rover files list pictures
      rover files info pictures/MOE-1.jpg
      rover files get pictures/MOE-1.jpg
      rover files watch
    """


@files.command("list")
@click.argument("folder", required=False)
@to_option
def list_files(folder: str | None, to: Target) -> None:
    """List the files of FOLDER and of the folders in it, or all.

    At most 1000 are listed: those that were changed last.

    \b
    Examples:
      rover files list
      rover files list pictures
    """
    _run(_list(to, folder))


@files.command()
@click.argument("path")
@to_option
def info(path: str, to: Target) -> None:
    """Describe a file: its checksum, and where the rover was when it took the picture.

    \b
    Example:
      rover files info pictures/MOE-1.jpg
    """
    _run(_info(to, path))


@files.command()
@click.argument("path")
@click.argument("target", required=False, type=click.Path(path_type=Path))
@click.option("--force", is_flag=True, help="Replace TARGET if it exists.")
@click.option(
    "--chunk",
    type=click.IntRange(1, LARGEST_CHUNK),
    metavar="OCTETS",
    help="Octets of one message; less for a slow link. The rover's choice by default.",
)
@to_option
def get(path: str, target: Path | None, force: bool, chunk: int | None, to: Target) -> None:
    """Fetch a file into TARGET, a folder or a name; into this folder by default.

    What came lies in TARGET.CHECKSUM.part until it is whole and its CRC-32 is right. After a loss
    of the link, or when it was interrupted, it goes on with the rest.

    \b
    Examples:
      rover files get pictures/MOE-1.jpg
      rover files get pictures/MOE-1.jpg rock.jpg
    """
    target = target or Path()
    if target.is_dir():
        target /= PurePosixPath(path).name
    if target.exists() and not force:
        raise click.UsageError(f"{target} exists: name another, or use --force")
    _run(_get(to, path, target, chunk))


@files.command()
@to_option
def watch(to: Target) -> None:
    """Print what happens to files, until Ctrl-C.

    \b
    Example:
      rover files watch
    """
    _run(_watch(to))


@files.command()
@click.argument("path")
@to_option
def cancel(path: str, to: Target) -> None:
    """End every transfer of a file, whoever fetches it.

    \b
    Example:
      rover files cancel pictures/MOE-1.jpg
    """
    _run(_cancel(to, path))


def _run(session: Coroutine[Any, Any, None]) -> None:
    """Run a session; what the rover answers by an error, or cannot be stored here, exits 1."""
    from adapters.mal import MalError
    from adapters.mrs.ground import TransferError
    from adapters.mrs.spec import describe_error

    try:
        asyncio.run(session)
    except MalError as error:
        _fail(describe_error(error))
    except ConnectionError:
        raise
    except (TransferError, OSError) as error:
        _fail(str(error))


def _fail(text: str) -> None:
    click.echo(f"Error: {text}", err=True)
    sys.exit(FAILED)


async def _connect(to: Target) -> "MrsClient":
    from adapters.mrs.ground import MrsClient

    return await connect(MrsClient, to, "MOE")


async def _list(to: Target, folder: str | None) -> None:
    from rich.console import Console

    async with await _connect(to) as client:
        Console().print(_table(await client.list_files(folder)))


async def _info(to: Target, path: str) -> None:
    async with await _connect(to) as client:
        file = await client.get_attributes(path)
    said = {
        "path": file.path,
        "size": f"{file.size} octets",
        "modified": f"{_time(file)} UTC",
        "media type": file.mimeType or "not known",
        "CRC-32": "not known" if file.checksum is None else f"{file.checksum:08x}",
    }
    said |= {
        known.name: _figure(known.name, known.value.value)
        for known in file.metaData or ()
        if known.value is not None
    }
    for name, text in said.items():
        click.echo(f"{name:<11} {text}")


async def _get(to: Target, path: str, target: Path, chunk: int | None) -> None:
    from rich.markup import escape
    from rich.progress import DownloadColumn, Progress, TimeRemainingColumn, TransferSpeedColumn

    columns = (DownloadColumn(), TransferSpeedColumn(), TimeRemainingColumn())
    async with await _connect(to) as client:
        await _require_file(client, path)
        with Progress(*Progress.get_default_columns()[:2], *columns) as bar:
            task = bar.add_task(escape(PurePosixPath(path).name), total=None)
            await client.retrieve_file(
                path,
                target,
                lambda done, size: bar.update(task, completed=done, total=size),
                chunk,
            )
    click.echo(str(target))


async def _require_file(client: "MrsClient", path: str) -> None:
    """Check that there is such a file before anything is shown of its coming.

    Raises:
        MalError: there is none.
        IsADirectoryError: it is a folder.
    """
    from adapters.mal import MalError

    try:
        await client.get_attributes(path)
    except MalError as error:
        try:
            await client.list_files(path)
        except MalError:
            raise error from None
        text = f"{path} is a folder: `rover files list {path}` shows what can be fetched of it"
        raise IsADirectoryError(text) from error


async def _watch(to: Target) -> None:
    async with await _connect(to) as client:
        news = await client.file_events()
        asset = await client.get_asset()
        click.echo(f"watching the files of {asset.asset}, until Ctrl-C")
        async for each in news:
            file = each.file
            now = f"{datetime.now():%H:%M:%S}"
            click.echo(f"{now}  {each.event.name:<11}  {file.path}  {file.size} octets")


async def _cancel(to: Target, path: str) -> None:
    async with await _connect(to) as client:
        await client.cancel_transfer(path)


def _figure(name: str, value: object) -> str:
    """Return what is kept with a picture, with its unit where the MRS gives it one."""
    from executive.state import DEFINITIONS

    if not isinstance(value, float):
        return str(value)
    units = {each.parameter.value: each.unit for each in DEFINITIONS}
    return f"{value:g} {units.get(name, '')}".rstrip()


def _table(found: "tuple[FileInfo, ...]") -> "Table":
    from rich import box
    from rich.markup import escape
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD)
    table.add_column("path", overflow="fold")
    table.add_column("octets", justify="right", no_wrap=True)
    table.add_column("changed, UTC", no_wrap=True)
    for file in found:
        table.add_row(escape(file.path), str(file.size), _time(file))
    return table


def _time(file: "FileInfo") -> str:
    return f"{datetime.fromtimestamp(file.modified / 1e9, UTC):%Y-%m-%d %H:%M:%S}"
