"""`rover bench`: every figure in one run, or one benchmark at a time."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from tests.support.figures import Figure
if TYPE_CHECKING:
    from tests.support.figures import Figure
if TYPE_CHECKING:
    from executive.settings import Settings
    from tests.support.figures import Figure


Measure = Callable[[], "list[Figure]"]

JSON = click.option(
    "--json",
    "json_path",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Write every figure with unit, comparison and goal to a JSON file.",
)


def run(measures: list[Measure], json_path: Path | None) -> None:
    """Measure, print a table, write figures, and end with 1 where a goal is missed."""
    from rich.console import Console

    from executive.settings import SettingsError
    from tests.support.figures import table, write_json

    if json_path is not None and not json_path.parent.is_dir():
        raise click.UsageError(f"--json: there is no folder {json_path.parent}")
    figures = []
    for measure in measures:
        try:
            figures += measure()
        except SettingsError as error:
            raise click.UsageError(str(error)) from error
    Console().print(table(figures))
    if json_path is not None:
        write_json(figures, json_path)
        click.echo(f"figures written to {json_path}")
    missed = [figure.name for figure in figures if figure.met is False]
    if missed:
        click.echo(f"goals missed: {', '.join(missed)}")
        raise click.exceptions.Exit(1)


@click.command("bundle", epilog="Example: rover bench bundle --bundles 2000")
@JSON
@click.option("--bundles", "count", type=click.IntRange(100), default=20_000, show_default=True)
def bundle_command(count: int, json_path: Path | None) -> None:
    """Embedded bundle agents: durable throughput, recovery, memory, restart."""
    run([lambda: bundle(count)], json_path)


@click.command("bundle-fuzz", epilog="Example: rover bench bundle-fuzz --messages 10000")
@JSON
@click.option("--messages", type=click.IntRange(100), default=300_000, show_default=True)
@click.option("--seed", type=int, default=1, show_default=True)
def bundle_fuzz_command(messages: int, seed: int, json_path: Path | None) -> None:
    """Wrong bundles, LTP segments and TCPCL streams against a node."""
    run([lambda: _bundle_fuzz(messages, seed)], json_path)


@click.command("mops-fuzz", epilog="Example: rover bench mops-fuzz --messages 10000")
@JSON
@click.option("--messages", type=click.IntRange(100), default=300_000, show_default=True)
@click.option("--seed", type=int, default=1, show_default=True)
def mops_fuzz_command(messages: int, seed: int, json_path: Path | None) -> None:
    """Wrong MOPS strings against all who read them."""
    run([lambda: _mops_fuzz(messages, seed)], json_path)


@click.command("relay", epilog="Example: rover bench relay --messages 500 --kills 4")
@JSON
@click.option(
    "--messages",
    type=click.IntRange(10),
    default=10_000,
    show_default=True,
    help="Commands up, and reports down.",
)
@click.option("--kills", type=click.IntRange(0), default=20, show_default=True)
@click.option("--loss", type=click.FloatRange(0.0, 0.9), default=0.1, show_default=True)
@click.option("--seed", type=int, default=1, show_default=True)
@click.option(
    "--keep",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    help="An empty folder for journals, records and logs.  [default: they are deleted]",
)
def relay_command(
    messages: int, kills: int, loss: float, seed: int, keep: Path | None, json_path: Path | None
) -> None:
    """Orbiter and rover-relay killed over a bad link: is a message lost, or there twice?"""
    run([lambda: _relay(messages, kills, loss, seed, keep)], json_path)


def bundle(count: int = 20_000) -> "list[Figure]":
    """Measure bundle agents."""
    from tests.benchmarks import bundle as bench

    click.echo(f"bundles: {count} between two agents, 100000 in a queue ...", err=True)
    return bench.measure(count)


def _bundle_fuzz(messages: int, seed: int) -> "list[Figure]":
    from tests.stress import bundle_fuzz

    click.echo(f"bundle fuzz: {messages} wrong messages ...", err=True)
    return bundle_fuzz.measure(messages, seed, lambda line: click.echo(line, err=True))


def _mops_fuzz(messages: int, seed: int) -> "list[Figure]":
    from executive.settings import load_settings
    from tests.stress import mops_fuzz

    click.echo(f"MOPS fuzz: {messages} wrong messages ...", err=True)
    settings = load_settings("jackal")
    return mops_fuzz.measure(settings, messages, seed, lambda line: click.echo(line, err=True))


def _relay(messages: int, kills: int, loss: float, seed: int, keep: Path | None) -> "list[Figure]":
    from sim.processes import ChildError, PlaceError
    from tests.stress import relay_storm
    from tests.stress.relay_storm import Plan

    click.echo(f"relay: {messages} messages each way, {kills} kills ...", err=True)
    plan = Plan(messages, kills, loss, seed)
    try:
        return relay_storm.measure(plan, lambda line: click.echo(line, err=True), keep)
    except (ChildError, PlaceError, TimeoutError) as error:
        raise click.ClickException(str(error)) from error


link_commands = (bundle_command, bundle_fuzz_command, mops_fuzz_command, relay_command)


@click.group(invoke_without_command=True)
@JSON
@click.pass_context
def bench(context: click.Context, json_path: Path | None) -> None:
    """Measure the executive against its goals; without a name, everything (about 5 minutes).

    Figures that are times depend on the machine and on what else it does: ratios were taken in
    one run, and are what counts.

    \b
    Examples:
      rover bench
      rover bench --json figures.json
      rover bench locomotion --goals my-goals.json --controller turn-drive

    \b
    Exit status: 0 all goals are met, 1 some are not, 2 a file or an option makes no sense.
    """
    if context.invoked_subcommand is None:
        run([_lockstep, _locomotion, _storm, _mal, bundle, _stop, _footprint], json_path)


@bench.command("stop", epilog="Example: rover bench stop --samples 1000")
@JSON
@click.option("--samples", type=click.IntRange(10), default=300, show_default=True)
def stop_command(samples: int, json_path: Path | None) -> None:
    """Octets of a stop to zero on cmd_vel, beside a bare echo."""
    run([lambda: _stop(samples)], json_path)


@bench.command("footprint", epilog="Example: rover bench footprint")
@JSON
def footprint_command(json_path: Path | None) -> None:
    """CPU and memory of the executive's process, beside a bare node."""
    run([_footprint], json_path)


@bench.command("mal", epilog="Example: rover bench mal --seconds 2")
@JSON
@click.option(
    "--seconds",
    type=click.FloatRange(1.0),
    default=5.0,
    show_default=True,
    help="How long notifications are taken for each number of subscribers.",
)
def mal_command(seconds: float, json_path: Path | None) -> None:
    """Requests, notifications and a transfer on loopback, beside plain asyncio TCP."""
    run([lambda: _mal(seconds)], json_path)


@bench.command("lockstep", epilog="Example: rover bench lockstep")
@JSON
def lockstep_command(json_path: Path | None) -> None:
    """Speed and repeatability of the lock step."""
    run([_lockstep], json_path)


@bench.command("storm", epilog="Example: rover bench storm --commands 5000")
@JSON
@click.option("--commands", "count", type=click.IntRange(1), default=100_000, show_default=True)
@click.option("--seed", type=int, default=1, show_default=True)
def storm_command(count: int, seed: int, json_path: Path | None) -> None:
    """Random commands, repeats, late arrivals and crashes, against the promises of the core."""
    run([lambda: _storm(count, seed)], json_path)


@bench.command("fuzz", epilog="Example: rover bench fuzz --messages 50000")
@JSON
@click.option("--messages", "count", type=click.IntRange(1), default=1_000_000, show_default=True)
@click.option("--seed", type=int, default=1, show_default=True)
def fuzz_command(count: int, seed: int, json_path: Path | None) -> None:
    """Wrong messages against living providers: does any promise break? (about 4 minutes)."""
    run([lambda: _fuzz(count, seed)], json_path)


@bench.command("kills", epilog="Example: rover bench kills --kills 5")
@JSON
@click.option("--kills", "count", type=click.IntRange(1), default=50, show_default=True)
@click.option("--seed", type=int, default=1, show_default=True)
@click.option(
    "--keep",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    help="An empty folder for ledger, journal and logs.  [default: they are deleted]",
)
def kills_command(count: int, seed: int, keep: Path | None, json_path: Path | None) -> None:
    """Kill -9 for client, broker and executive: does the client's view equal the ledger?"""
    run([lambda: _kills(count, seed, keep)], json_path)


@bench.command("locomotion", epilog="Example: rover bench locomotion --controller turn-drive")
@JSON
@click.option(
    "--goals",
    "goals_path",
    type=click.Path(path_type=Path),
    help="Goals file: limits, and goals with best known times.  [default: 24 goals of our own]",
)
@click.option(
    "--controller",
    type=click.Choice(["turn-drive", "turn-drive-trapezoid"]),
    default="turn-drive",
    show_default=True,
    help="What drives.",
)
@click.option(
    "--most",
    type=click.FloatRange(0.0, min_open=True),
    help="Greatest sum of times over best known.  [default: 1.45]",
)
def locomotion_command(
    goals_path: Path | None, controller: str, most: float | None, json_path: Path | None
) -> None:
    """Drive to goals in lock step: times against best known, true errors."""
    run([lambda: _locomotion(goals_path, controller, most)], json_path)


def _settings() -> "Settings":
    from executive.settings import load_settings

    return load_settings("jackal")


def _stop(samples: int = 300) -> "list[Figure]":
    from tests.benchmarks import stop

    click.echo(f"stop: {samples} stops and echoes in turn ...", err=True)
    return stop.measure(samples)


def _footprint() -> "list[Figure]":
    from tests.benchmarks import footprint

    click.echo("footprint: 20 s of driving ...", err=True)
    return footprint.measure()


def _mal(seconds: float = 5.0) -> "list[Figure]":
    from tests.benchmarks import mal

    click.echo("MAL: requests, notifications, transfers ...", err=True)
    return mal.measure(duration_s=seconds)


def _lockstep() -> "list[Figure]":
    from tests.benchmarks import lock_step

    click.echo("lock step: six runs ...", err=True)
    return lock_step.measure()


def _storm(count: int = 100_000, seed: int = 1) -> "list[Figure]":
    from tests.stress import core_storm

    click.echo(f"storm: {count} commands ...", err=True)
    return core_storm.measure(_settings(), count, seed)


def _fuzz(count: int, seed: int) -> "list[Figure]":
    from tests.stress import mal_fuzz

    click.echo(f"fuzz: {count} messages ...", err=True)
    return mal_fuzz.measure(_settings(), count, seed, lambda line: click.echo(line, err=True))


def _kills(count: int, seed: int, keep: Path | None) -> "list[Figure]":
    from sim.processes import ChildError, PlaceError
    from tests.stress import kills

    click.echo(f"kills: {count}, about {4 * count + 20} s ...", err=True)
    try:
        return kills.measure(count, seed, lambda line: click.echo(line, err=True), keep)
    except (ChildError, PlaceError, TimeoutError) as error:
        raise click.ClickException(str(error)) from error


def _locomotion(
    path: Path | None = None, controller: str = "turn-drive", most: float | None = None
) -> "list[Figure]":
    from tests.benchmarks import locomotion
    from tests.benchmarks.locomotion import OWN_GOALS, read_goals

    goals = read_goals(path or OWN_GOALS)
    bound = most or (1.45 if path else 1.35)

    def tell(run: locomotion.Run) -> None:
        end = "done" if run.done else "NOT DONE"
        click.echo(
            f"{run.goal.id}: {end} in {run.time_s:.2f} s (best known"
            f" {run.goal.best_known_time_s:.2f} s), true error {100 * run.true_error_m:.2f} cm",
            err=True,
        )

    return locomotion.measure(goals, locomotion.Controller(controller), _settings(), bound, tell)


for each in link_commands:
    bench.add_command(each)
