"""`rover command deleteFile` and `moveFile`: what changes the folder aboard."""

import click

from adapters.mrs.cli.arguments import Operation
from adapters.mrs.cli.sending import Sending
from executive.commands import DeleteFile, MoveFile


@click.command("deleteFile", cls=Operation)
@click.argument("path")
@click.pass_obj
def delete_file(sending: Sending, path: str) -> None:
    """Delete a file aboard; `rover files list` shows which there are.

    \b
    Example:
      rover command deleteFile pictures/MOE-1.jpg
    """
    sending.send(DeleteFile(path))


@click.command("moveFile", cls=Operation)
@click.argument("path")
@click.argument("target")
@click.pass_obj
def move_file(sending: Sending, path: str, target: str) -> None:
    """Give a file aboard another path, where nothing lies yet.

    \b
    Example:
      rover command moveFile pictures/MOE-1.jpg kept/rock.jpg
    """
    sending.send(MoveFile(path, target))
