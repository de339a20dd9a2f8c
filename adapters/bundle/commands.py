"""The command `rover bundle`: checks of bundles that come from outside."""

from pathlib import Path

import click


class _BadFile(click.ClickException):
    exit_code = 2


@click.group()
def bundle() -> None:
    """Look into bundles of the Bundle Protocol, version 7.

    \b
    Example:
      rover bundle check vectors.json
    """


@bundle.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--verbose", is_flag=True, help="Name what agrees, too.")
def check(file: Path, verbose: bool) -> None:
    """Check recorded bundles, LTP segments and TCPCL streams, octet for octet.

    FILE is JSON with a list of vectors, each with its octets in hex and the fields they are known
    to have. Each is decoded, its CRCs are verified, it is compared, encoded again and compared with
    itself. Bundles with an "expected_verdict" are judged by their signatures (RFC 9173, or NASA
    ION's form of it), with the key and for the targets that the vector names: one line for each.

    Exit status: 0 if everything agrees, 1 if something does not or there is nothing, 2 if FILE
    cannot be used.

    \b
    Example:
      rover bundle check vectors.json
    """
    from adapters.bundle.vector_check import VectorFileError, check_file

    try:
        verdicts = check_file(file)
    except VectorFileError as fault:
        raise _BadFile(_line(str(fault))) from fault
    for verdict in verdicts:
        for disagreement in verdict.disagreements:
            click.echo(_line(f"{verdict.label}: {disagreement}"))
        if not verdict.disagreements and (verbose or verdict.found):
            click.echo(_line(f"{verdict.label}: {verdict.found or 'agrees'}"))
    agree = sum(not verdict.disagreements for verdict in verdicts)
    click.echo(f"{agree} of {len(verdicts)} agree")
    if not agree or agree < len(verdicts):
        raise SystemExit(1)


@bundle.command()
@click.argument("file", type=click.Path(path_type=Path))
def key(file: Path) -> None:
    """Make a key of 32 random octets, with which both ends sign their bundles.

    FILE must not exist. Only its owner may read it; bring it to the other end in secret. The
    section `security` of a relay's settings names it.

    Exit status: 0, or 2 if FILE cannot be written.

    \b
    Example:
      rover bundle key config/relay.key
    """
    from adapters.bundle.node.security import KEY_OCTETS, make_key

    try:
        make_key(file)
    except OSError as fault:
        raise _BadFile(_line(f"{file}: {fault.strerror}")) from fault
    click.echo(f"{file}: {KEY_OCTETS} octets")


def _line(text: str) -> str:
    """One line that any terminal takes, whatever a file from outside has in its names."""
    return " ".join(text.split()).encode(errors="backslashreplace").decode()
