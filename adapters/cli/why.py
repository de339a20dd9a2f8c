"""The command `rover why`: explains a command's result, or the present standstill or motion."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from adapters.cli.history_options import (
    date_and_time,
    file_option,
    query_history,
    read_file,
    since_began,
)
from adapters.explanation import (
    Explanation,
    TimeFormatter,
    UnknownCommandError,
    explain_command,
    explain_node,
    explain_now,
    explanation_lines,
)
from adapters.mrs.cli import (
    RoverTarget,
    command_numbers,
    completion,
    connect,
    echo_json,
    echo_line,
    json_option,
    run,
    to_option,
)
from executive.history import RunHistory

if TYPE_CHECKING:
    from adapters.mrs.ground import MrsClient


@click.command()
@click.argument(
    "command",
    required=False,
    metavar="[COMMAND]",
    shell_complete=completion(command_numbers),
)
@to_option
@file_option
@click.option(
    "--at",
    "at_s",
    type=float,
    metavar="SECONDS",
    help="With --file: the state at this time, in seconds since the start of the recording.",
)
@json_option
def why(
    command: str | None, to: RoverTarget, recording: Path | None, at_s: float | None, as_json: bool
) -> None:
    """Explain the result of a command, a node of a plan, or the present standstill or motion.

    A command is given by its number, or as SOURCE:NUMBER. Its explanation shows source, link, wait,
    the branches of a plan above it, the leaves of the tree that executed it, speed limits,
    its end, and the evidence. A rover stores its last 1000 commands; of older ones, and from before
    a restart, it has only the reports.

    A node of a plan is given by its path, or the end of it. Its explanation shows the branches that
    it took, and why, its last failure, and its next time.

    \b
    Examples:
      rover why
      rover why MOE:1
      rover why survey/photo
      rover why --file run.mcap
      rover why MOE:1 --file run.mcap
      rover why --file run.mcap --at 4.5

    \b
    Exit status: 0 explained, 2 usage error, 3 rover not reachable.
    """
    if recording is not None:
        history, began_utc_s = read_file(recording, at_s)
        _print_explanation(_explained(history, command), since_began(began_utc_s), as_json)
    elif at_s is not None:
        raise click.UsageError("--at needs --file RUN.mcap: a rover only explains the present")
    else:
        run(_print_why(to, command, as_json))


async def _print_why(to: RoverTarget, command: str | None, as_json: bool) -> None:
    async with await connect(to) as client:
        if command is not None and not command.rpartition(":")[2].isdigit():
            explanation = await _explained_node(client, command)
        else:
            explanation = _explained(await query_history(client, command), command)
    _print_explanation(explanation, date_and_time, as_json)


async def _explained_node(client: "MrsClient", name: str) -> Explanation:
    """Explain a node of the plan that changed last, of those with such a node."""
    plans = sorted(await client.get_plan_status(), key=lambda each: each.utc_s, reverse=True)
    for each in plans:
        try:
            found = explain_node(await client.get_plan_nodes(each.plan_id), name)
        except UnknownCommandError as error:
            raise click.UsageError(str(error)) from error
        if found is not None:
            return found
    text = f"{name[:64]!r} is neither NUMBER nor SOURCE:NUMBER, and no node of a plan"
    raise click.UsageError(f"{text}; `rover log` lists all commands")


def _explained(history: RunHistory, command: str | None) -> Explanation:
    try:
        return explain_now(history) if command is None else explain_command(history, command)
    except UnknownCommandError as error:
        raise click.UsageError(f"{error}; `rover log` lists all") from error


def _print_explanation(explanation: Explanation, when: TimeFormatter, as_json: bool) -> None:
    if as_json:
        echo_json(explanation)
        return
    for line in explanation_lines(explanation, when):
        echo_line(line)
