"""The command `rover bundle`: `rover bundle key` generates a key that signs bundles."""

from pathlib import Path

import click


class _InvalidFileError(click.ClickException):
    exit_code = 2


@click.group()
def bundle() -> None:
    """Generate keys that sign bundles of the Bundle Protocol, version 7.

    \b
    Example:
      rover bundle key config/relay.key
    """


@bundle.command()
@click.argument("file", type=click.Path(path_type=Path))
def key(file: Path) -> None:
    """Generate a key of 32 random octets; both ends sign their bundles with it.

    FILE must not exist. Only its owner may read it; copy it to the other end in secret. The
    section `security` of a relay's settings names it.

    Exit status: 0, or 2 if FILE cannot be written.

    \b
    Example:
      rover bundle key config/relay.key
    """
    from adapters.bundle.node.security import KEY_OCTETS, make_key

    name = click.format_filename(file)
    try:
        make_key(file)
    except OSError as error:
        raise _InvalidFileError(f"{name}: {error.strerror}") from error
    click.echo(f"{name}: {KEY_OCTETS} octets")
