"""The command `rover mal`: checks of MAL messages that come from outside."""

from collections import Counter
from pathlib import Path

import click


class _BadFile(click.ClickException):
    exit_code = 2


@click.group()
def mal() -> None:
    """Look into messages of the CCSDS Message Abstraction Layer.

    \b
    Example:
      rover mal check vectors.json
    """


@mal.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option(
    "--encoding",
    type=click.Choice(["fixed", "variable", "split"]),
    help="Check only messages whose body is in this encoding.",
)
@click.option("--verbose", is_flag=True, help="Name the messages that agree, too.")
def check(file: Path, encoding: str | None, verbose: bool) -> None:
    """Check captured messages against this MAL stack, octet for octet.

    FILE is JSON with a testSpecification and a list of vectors. Each message is decoded, compared
    with the header and the value given for it, encoded again and compared with itself.

    Exit status: 0 if every message agrees, 1 if one does not or there is none, 2 if FILE cannot
    be used.

    \b
    Example:
      rover mal check vectors.json --encoding fixed
    """
    from adapters.mal.vector_check import VectorFileError, load_vectors

    try:
        checker = load_vectors(file)
    except VectorFileError as fault:
        raise _BadFile(_line(str(fault))) from fault
    verdicts: Counter[bool] = Counter()
    for vector in checker.vectors:
        if encoding not in (None, vector.encoding):
            continue
        lines = list(checker.disagreements(vector))
        verdicts[not lines] += 1
        for line in lines:
            click.echo(_line(f"{vector.label}: {line}"))
        if verbose and not lines:
            click.echo(_line(f"{vector.label}: agrees"))
    click.echo(f"{verdicts[True]} of {verdicts.total()} agree")
    if not verdicts[True] or verdicts[False]:
        raise SystemExit(1)


def _line(text: str) -> str:
    """One line that any terminal takes, whatever a file from outside has in its names."""
    return " ".join(text.split()).encode(errors="backslashreplace").decode()
