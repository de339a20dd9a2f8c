"""The command `rover files`: lists, describes, fetches and watches the files of a rover."""

from datetime import datetime
from pathlib import Path, PurePosixPath
from typing import Final

import click

from adapters.mal import MalError
from adapters.mrs.cli.options import RoverTarget, json_option, to_option
from adapters.mrs.cli.terminal import (
    completion,
    connect,
    echo_json,
    echo_line,
    file_paths,
    in_session,
    print_table,
    run,
    utc,
)
from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import FileInfo
from executive.values.parameters import Parameter
from executive.values.quantities import quantity_text

MAX_CHUNK_OCTETS: Final = 1 << 18


class _FilesGroup(click.Group):
    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        return super().get_command(ctx, "fetch" if cmd_name == "get" else cmd_name)  # in scripts


@click.group(cls=_FilesGroup)
def files() -> None:
    """List, describe, fetch and watch the files of a rover.

    Deletion and moving are commands: rover command deleteFile, rover command moveFile.

    \b
    Examples:
      rover files list pictures
      rover files info pictures/MOE-1.jpg
      rover files fetch pictures/MOE-1.jpg
      rover files watch
    """


@files.command("list")
@click.argument("folder", required=False)
@json_option
@in_session
async def list_files(client: MrsClient, folder: str | None, as_json: bool) -> None:
    """List the files of FOLDER and its subfolders, or all.

    At most 1000 are listed: those changed last.

    \b
    Examples:
      rover files list
      rover files list pictures
    """
    found = await client.list_files(folder)
    if as_json:
        for file in found:
            echo_json(file)
        return
    rows = ((file.path, str(file.size), utc(file.modified)) for file in found)
    print_table(rows, "path", "octets", "changed, UTC")


@files.command()
@click.argument("path", shell_complete=completion(file_paths))
@json_option
@in_session
async def info(client: MrsClient, path: str, as_json: bool) -> None:
    """Show the attributes of a file: checksum, and for a picture the rover's pose.

    \b
    Example:
      rover files info pictures/MOE-1.jpg
    """
    file = await client.get_attributes(path)
    if as_json:
        echo_json(file)
        return
    for name, text in _described(file).items():
        echo_line(f"{name:<11} {text}")


@files.command()
@click.argument("path", shell_complete=completion(file_paths))
@click.argument("target", required=False)
@click.option("--force", is_flag=True, help="Replace TARGET if it exists.")
@click.option(
    "--chunk",
    type=click.IntRange(1, MAX_CHUNK_OCTETS),
    metavar="OCTETS",
    help="Octets of a chunk; smaller for a slow link. The rover's default if omitted.",
)
@to_option
def fetch(path: str, target: str | None, force: bool, chunk: int | None, to: RoverTarget) -> None:
    """Fetch a file into TARGET, a folder or a name; into the current folder by default.

    Received octets are stored in TARGET.CHECKSUM.part until the file is complete with a correct
    CRC-32. After a loss of the link or an interruption the transfer continues.

    \b
    Examples:
      rover files fetch pictures/MOE-1.jpg
      rover files fetch pictures/MOE-1.jpg rock.jpg
    """
    here = Path(target or ".")
    if here.is_dir():
        here /= PurePosixPath(path).name
    elif target and target.endswith("/"):
        raise click.UsageError(f"folder {target} does not exist: create it, or give a file name")
    if here.exists() and not force:
        raise click.UsageError(f"{here} exists: give another name, or use --force")
    run(_get(to, path, here, chunk))


@files.command()
@json_option
@in_session
async def watch(client: MrsClient, as_json: bool) -> None:
    """Print changes of files until Ctrl-C.

    \b
    Example:
      rover files watch
    """
    events = await client.file_events()
    asset = await client.get_asset()
    echo_line(f"watching the files of {asset.asset}, until Ctrl-C", err=as_json)
    async for each in events:
        if as_json:
            echo_json(each)
            continue
        file, now = each.file, f"{datetime.now():%H:%M:%S}"
        echo_line(f"{now}  {each.event.name:<11}  {file.path}  {file.size} octets")


@files.command()
@click.argument("path", shell_complete=completion(file_paths))
@in_session
async def cancel(client: MrsClient, path: str) -> None:
    """Cancel your transfers of a file; with TLS and the authority, those of all.

    \b
    Example:
      rover files cancel pictures/MOE-1.jpg
    """
    await client.cancel_transfer(path)


def _described(file: FileInfo) -> dict[str, str]:
    units = {each.value: each.unit for each in Parameter}
    known = {
        each.name: quantity_text(value, units.get(each.name, ""))
        if isinstance(value := each.value.value, float)
        else str(value)
        for each in file.metaData or ()
        if each.value is not None
    }
    return {
        "path": file.path,
        "size": f"{file.size} octets",
        "modified": f"{utc(file.modified)} UTC",
        "media type": file.mimeType or "unknown",
        "CRC-32": "unknown" if file.checksum is None else f"{file.checksum:08x}",
    } | known


async def _get(to: RoverTarget, path: str, target: Path, chunk: int | None) -> None:
    from rich.markup import escape
    from rich.progress import DownloadColumn, Progress, TimeRemainingColumn, TransferSpeedColumn

    columns = (DownloadColumn(), TransferSpeedColumn(), TimeRemainingColumn())
    async with await connect(to) as client:
        await _require_file(client, path)
        with Progress(*Progress.get_default_columns()[:2], *columns) as bar:
            task = bar.add_task(escape(PurePosixPath(path).name), total=None)
            await client.retrieve_file(
                path, target, lambda done, size: bar.update(task, completed=done, total=size), chunk
            )
    click.echo(str(target))


async def _require_file(client: MrsClient, path: str) -> None:
    """Check that a file exists before the progress bar is shown.

    Raises:
        MalError: the file does not exist.
        IsADirectoryError: it is a folder.
    """
    try:
        await client.get_attributes(path)
    except MalError as error:
        try:
            await client.list_files(path)
        except MalError:
            raise error from None
        text = f"{path} is a folder: `rover files list {path}` lists its files"
        raise IsADirectoryError(text) from error
