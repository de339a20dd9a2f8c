"""The command `rover plan`: submits, controls and watches plans on a rover."""

import sys
from collections.abc import Callable
from datetime import datetime
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any, Final

import click

from adapters.mal import MalError, StandardError
from adapters.mrs.cli.options import RoverTarget, json_option, to_option
from adapters.mrs.cli.plan_check_command import (
    ARGUMENTS,
    FILE,
    ID,
    check,
    definition_of,
    prove,
    refuse,
)
from adapters.mrs.cli.plan_nodes_table import print_nodes
from adapters.mrs.cli.sending import CommandSender
from adapters.mrs.cli.terminal import (
    FAILED,
    completion,
    echo_json,
    echo_line,
    fail,
    in_session,
    plain_fields,
    plan_ids,
    print_table,
)
from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import AreaError, wire_node, wire_update
from executive.commands import (
    AbortPlan,
    ActivatePlan,
    AnswerQuestion,
    CommandDeclaration,
    HoldAtNode,
    PlanArgument,
    PlanRequest,
    RemovePlan,
    Request,
    ResumePlan,
    RetryNode,
    SkipNode,
    SubmitPlan,
    SuspendPlan,
    declaration_of,
)
from executive.plans import read_plan
from executive.values.plan_nodes import PlanNodeReport
from executive.values.reasons import Refusal
from executive.values.reports import PlanStatus, PlanUpdate

_NO_NODES: Final = {StandardError.UNSUPPORTED_OPERATION.value, AreaError.REJECTED.value}
_NOT_SERVED: Final = AreaError.NOT_SUPPORTED.value
_NO_QUESTION: Final = "an orbiter reports plans with an open question only: there is none"
COLUMNS: Final = ("plan", "status", "leaves ended", "at", "text")


TRIAL: Final = EntryPoint("try", "sim.trial.commands:try_plan", "rover.commands")
"""The command that simulates a plan; it is loaded only when it is called."""


class _PlanGroup(click.Group):
    """The commands of this package, and `TRIAL`."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return sorted([*super().list_commands(ctx), TRIAL.name])

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name != TRIAL.name:
            return super().get_command(ctx, cmd_name)
        command: click.Command = TRIAL.load()
        return command


@click.group(cls=_PlanGroup)
def plan() -> None:
    """Check plans locally, submit them to a rover, control and watch them.

    A plan is a behaviour tree in the XML of BehaviorTree.CPP v4; docs/write-a-plan.md explains how
    to write one.

    \b
    Examples:
      rover plan check config/plans/look-around.xml
      rover plan prove config/plans/look-around.xml
      rover plan try config/plans/look-around.xml
      rover plan submit config/plans/look-around.xml
      rover plan activate look-around
      rover plan watch look-around
    """


for _command in (check, prove):
    plan.add_command(_command)


@plan.command()
@FILE
@ID
@ARGUMENTS
@to_option
def submit(
    file: Path, plan_id: str | None, arguments: tuple[PlanArgument, ...], to: RoverTarget
) -> None:
    """Check FILE, and submit it to a rover, which checks its own bounds and stores it.

    \b
    Examples:
      rover plan submit config/plans/look-around.xml
      rover plan submit there-and-back.xml --id survey-2 --arg far=3
    """
    definition = definition_of(file, plan_id, arguments)
    read = read_plan(definition)
    if isinstance(read, Refusal):
        refuse(file, read)
    CommandSender(to).send(SubmitPlan(definition))


def _add_control_command(
    kind: Callable[[str], PlanRequest], declaration: CommandDeclaration
) -> None:
    name = declaration.name.removesuffix("Plan")

    @plan.command(
        name, help=f"{declaration.summary}\n\n\b\nExample:\n  rover plan {name} look-around"
    )
    @click.argument("plan_id", metavar="PLAN", shell_complete=completion(plan_ids))
    @to_option
    def steer(plan_id: str, to: RoverTarget) -> None:
        CommandSender(to).send(kind(plan_id))


for _kind in (ActivatePlan, SuspendPlan, AbortPlan, RemovePlan):
    _add_control_command(_kind, declaration_of(_kind))


def _steering_command(name: str, *parameters: Any) -> Callable[..., Any]:
    """Return a decorator that adds a command which sends its request to a plan."""

    def add(make: Callable[..., PlanRequest]) -> Callable[..., PlanRequest]:
        def send(plan_id: str | None, to: RoverTarget, **values: Any) -> None:
            async def choose(client: MrsClient) -> Request:
                return make(plan_id or await _one_plan(client, *_ACTIVE), **values)

            CommandSender(to).send_chosen(choose)

        send.__doc__ = make.__doc__
        command = to_option(_OF(send))
        for parameter in reversed(parameters):
            command = parameter(command)
        plan.command(name)(command)
        return make

    return add


_NODE: Final = click.argument("node")
_OF: Final = click.option(
    "--plan",
    "plan_id",
    metavar="PLAN",
    shell_complete=completion(plan_ids),
    help="The plan; the only active or suspended one by default.",
)
_ACTIVE: Final = (PlanStatus.ACTIVATED, PlanStatus.EXECUTING, PlanStatus.SUSPENDED)


@_steering_command(
    "skip", _NODE, click.option("--failure", is_flag=True, help="Let it fail instead.")
)
def _skip(plan_id: str, node: str, failure: bool) -> PlanRequest:
    """End NODE of a plan as if it had succeeded; its commands are cancelled.

    A node that has not begun ends at once when the plan reaches it. NODE is a node's path, or
    the end of it.

    \b
    Examples:
      rover plan skip wp2
      rover plan skip survey/photo --failure --plan traverse
    """
    return SkipNode(plan_id, node, "FAILURE" if failure else "SUCCESS")


@_steering_command("retry", _NODE)
def _retry(plan_id: str, node: str) -> PlanRequest:
    """Begin NODE again, which is running; its commands are cancelled and given again.

    \b
    Example:
      rover plan retry wp2
    """
    return RetryNode(plan_id, node)


@_steering_command("hold", _NODE)
def _hold(plan_id: str, node: str) -> PlanRequest:
    """Suspend a plan before NODE begins; `rover plan resume` continues it.

    \b
    Example:
      rover plan hold photo
    """
    return HoldAtNode(plan_id, node)


@_steering_command("answer", click.argument("question", metavar="KEY"), click.argument("option"))
def _answer(plan_id: str, question: str, option: str) -> PlanRequest:
    """Answer the question KEY of a plan by OPTION, also in advance.

    The first answer counts. KEY is the path of the node, or the end of it.

    \b
    Example:
      rover plan answer ditch cross
    """
    return AnswerQuestion(plan_id, question, option)


@plan.command()
@click.argument("plan_id", metavar="[PLAN]", required=False, shell_complete=completion(plan_ids))
@click.option(
    "--at", "step", metavar="STEP", help="Step to continue at; those before it are skipped."
)
@to_option
def resume(plan_id: str | None, step: str | None, to: RoverTarget) -> None:
    """Continue PLAN, or the plan that is suspended, at its interrupted step.

    \b
    Examples:
      rover plan resume
      rover plan resume traverse --at wp3
    """

    async def choose(client: MrsClient) -> Request:
        return ResumePlan(plan_id or await _one_plan(client, PlanStatus.SUSPENDED), step)

    CommandSender(to).send_chosen(choose)


@plan.command()
@click.argument("plan_ids", metavar="[PLAN]...", nargs=-1, shell_complete=completion(plan_ids))
@json_option
@in_session
async def status(client: MrsClient, plan_ids: tuple[str, ...], as_json: bool) -> None:
    """Show the status of plans; all without PLAN. Of each PLAN, its nodes are shown, too.

    \b
    Examples:
      rover plan status
      rover plan status look-around
    """
    try:
        plans = await client.get_plan_status(*plan_ids)
    except MalError as error:
        if error.number != _NOT_SERVED:
            raise
        await _print_questions(client, error, plan_ids, as_json)
        return
    if not plans:
        click.echo("" if as_json else "no plans: submit one with `rover plan submit`\n", nl=False)
    elif not as_json:
        print_table(map(plan_row, plans), *COLUMNS)
    for update in plans:
        nodes = await _nodes(client, update.plan_id) if plan_ids else ()
        if as_json:
            rows = {"nodes": tuple(map(wire_node, nodes))} if nodes else {}
            echo_json({**plain_fields(wire_update(update)), **rows})
        elif nodes:
            print_nodes(nodes)


async def _questioned_plan(client: MrsClient, refused: MalError) -> str | None:
    """Return the plan with an open question, if any; an orbiter reports no others.

    Raises:
        MalError: `refused`, the error of the service of plans, if there is no status either.
    """
    try:
        return (await client.get_status()).activePlan
    except MalError as error:
        raise (refused if error.number == _NOT_SERVED else error) from None


async def _print_questions(
    client: MrsClient, refused: MalError, plan_ids: tuple[str, ...], as_json: bool
) -> None:
    """Print the open questions of plans, all that an orbiter knows of them."""
    for plan_id in plan_ids or filter(None, (await _questioned_plan(client, refused),)):
        nodes = await _nodes(client, plan_id)
        if as_json:
            echo_json({"planId": plan_id, "nodes": tuple(map(wire_node, nodes))})
        else:
            print_nodes(nodes)
        plan_ids = (plan_id,)
    if not plan_ids:
        fail(_NO_QUESTION)


async def _nodes(client: MrsClient, plan_id: str) -> tuple[PlanNodeReport, ...]:
    """Return the nodes of a plan; none of a rover that does not report them."""
    try:
        return await client.get_plan_nodes(plan_id)
    except MalError as error:
        if error.number in _NO_NODES:
            return ()
        raise


@plan.command()
@click.argument("plan_id", metavar="[PLAN]", required=False, shell_complete=completion(plan_ids))
@json_option
@in_session
async def watch(client: MrsClient, plan_id: str | None, as_json: bool) -> None:
    """Print status updates of plans until Ctrl-C; with PLAN, until it has ended.

    Exits 0 when PLAN is COMPLETED, 1 when it is FAILED or ABORTED.

    \b
    Examples:
      rover plan watch
      rover plan watch look-around
    """
    lines, updates = PlanLines(), await client.plan_updates()
    for update in await client.get_plan_status(*([] if plan_id is None else [plan_id])):
        updates.put(update)
    async for update in updates:
        if plan_id not in {None, update.plan_id}:
            continue
        if as_json:
            echo_json(wire_update(update))
        else:
            echo_line(lines.line(update))
        if update.plan_id == plan_id and _is_over(update):
            return


@plan.command()
def nodes() -> None:
    """Print all nodes of plans as a palette for Groot2, to draw plans.

    \b
    Example:
      rover plan nodes > nodes.xml
    """
    from adapters.mrs.cli.plan_palette import palette

    click.echo(palette(), nl=False)


async def _one_plan(client: MrsClient, *statuses: PlanStatus) -> str:
    """Return the only plan in one of some statuses."""
    try:
        plans = await client.get_plan_status()
    except MalError as error:
        if error.number != _NOT_SERVED:
            raise
        plan_id = await _questioned_plan(client, error)
        if plan_id is None:
            raise click.ClickException(f"name a plan; {_NO_QUESTION}") from None
        return plan_id
    found = [each.plan_id for each in plans if each.status in statuses]
    if len(found) != 1:
        names = " or ".join(status.name.lower() for status in statuses)
        raise click.ClickException(f"name a plan; {names}: {', '.join(found) or 'none'}")
    return found[0]


def _is_over(update: PlanUpdate) -> bool:
    """Return whether a plan is COMPLETED; exits 1 if it is FAILED or ABORTED."""
    if update.status in {PlanStatus.FAILED, PlanStatus.ABORTED}:
        sys.exit(FAILED)
    return update.status is PlanStatus.COMPLETED


def plan_row(update: PlanUpdate) -> tuple[str, ...]:
    """Return a plan as a table row; node paths are shown without the plan's prefix."""
    ended = f"{update.done} of {update.total}"
    return (update.plan_id, update.status.name, ended, _node(update), _text(update))


class PlanLines:
    """Formats updates as lines; a repeated text of a plan is shown once."""

    def __init__(self) -> None:
        self._last_texts: dict[str, str] = {}

    def line(self, update: PlanUpdate) -> str:
        """Return an update as one line: time, plan, status, ended leaves, node, and text."""
        time = datetime.fromtimestamp(update.utc_s)
        new_text = "" if self._last_texts.get(update.plan_id) == update.text else _text(update)
        self._last_texts[update.plan_id] = update.text
        ended = f"{update.done}/{update.total} ended"
        status = f"{update.status.name:<9}"
        head = (f"{time:%H:%M:%S}", update.plan_id, status, ended, _node(update))
        return "  ".join(part for part in (*head, new_text) if part)


def _node(update: PlanUpdate) -> str:
    return _short(update, update.node)


def _text(update: PlanUpdate) -> str:
    return _short(update, update.text).removeprefix(f"{_node(update)}: ")


def _short(update: PlanUpdate, text: str) -> str:
    return text.replace(f"plan:{update.plan_id}/", "")
