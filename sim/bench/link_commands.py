"""`rover bench bundle`, `bundle-fuzz`, `mops-fuzz`, `relay`: between orbiter and rover."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from sim.bench.output import JSON, run

if TYPE_CHECKING:
    from sim.bench.figures import Figure


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
    from sim.bench import bundle as bench

    click.echo(f"bundles: {count} between two agents, 100000 in a queue ...", err=True)
    return bench.measure(count)


def _bundle_fuzz(messages: int, seed: int) -> "list[Figure]":
    from sim.bench import bundle_fuzz

    click.echo(f"bundle fuzz: {messages} wrong messages ...", err=True)
    return bundle_fuzz.measure(messages, seed)


def _mops_fuzz(messages: int, seed: int) -> "list[Figure]":
    from executive.settings import load_settings
    from sim.bench import mops_fuzz

    click.echo(f"MOPS fuzz: {messages} wrong messages ...", err=True)
    settings = load_settings("jackal")
    return mops_fuzz.measure(settings, messages, seed, lambda line: click.echo(line, err=True))


def _relay(messages: int, kills: int, loss: float, seed: int, keep: Path | None) -> "list[Figure]":
    from sim.bench import relay_storm
    from sim.processes.children import ChildError
    from sim.processes.place import PlaceError
    from sim.relay_storm.mishaps import Plan

    click.echo(f"relay: {messages} messages each way, {kills} kills ...", err=True)
    plan = Plan(messages, kills, loss, seed)
    try:
        return relay_storm.measure(plan, lambda line: click.echo(line, err=True), keep)
    except (ChildError, PlaceError, TimeoutError) as error:
        raise click.ClickException(str(error)) from error


link_commands = (bundle_command, bundle_fuzz_command, mops_fuzz_command, relay_command)
