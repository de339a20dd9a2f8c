"""`rover bench`: every figure in one run, or one benchmark or attack at a time."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from tests.benchmarks import plan_commands as plan_commands
from tests.benchmarks.command_group import (
    COMMANDS,
    JSON,
    MEASURES,
    OUTPUT,
    SEED,
    benchmark,
    count,
    log,
    run,
)
from tests.benchmarks.competitors import COMPETITORS, OWN

if TYPE_CHECKING:
    from executive.settings import Settings
    from tests.support.figures import Figure

WHOLE: Final = ("lockstep", "locomotion", "storm", "mal", "bundle", "echo", "footprint", "pairs")
"""What is measured without a name."""


def _settings() -> "Settings":
    from executive.settings import load_settings

    return load_settings("jackal")


@benchmark("echo --samples 1000", count("--samples", 300, least=10))
def echo(count: int) -> "list[Figure]":
    """Octets of a stop to zero on cmd_vel, beside a bare echo."""
    from tests.benchmarks import onboard

    log(f"stop: {count} stops and echoes in turn ...")
    return onboard.measure_stops(count)


@benchmark(
    "stop --while plan --while hang",
    count("--samples", 100, least=10),
    click.option(
        "--while", "names", multiple=True, metavar="NAME",
        help="What else goes on; may be repeated.  [default: everything, one after the other]",
    ),
)  # fmt: skip
def stop(count: int, names: tuple[str, ...]) -> "list[Figure]":
    """How soon a stop acts, whatever else the executive is made to do (about 8 minutes)."""
    from tests.benchmarks import stop

    return stop.measure(count, names, log)


@benchmark(
    "sliding-stops --ice 60 --firm 12",
    click.option("--ice", type=click.IntRange(0), default=360, show_default=True),
    click.option("--firm", type=click.IntRange(0), default=60, show_default=True),
    SEED,
)
def sliding_stops(ice: int, firm: int, seed: int) -> "list[Figure]":
    """Stops on ice, slopes and firm ground: whether the rover truly stands when it says so."""
    from tests.benchmarks import sliding_stops

    return sliding_stops.measure(ice, firm, seed, log)


@benchmark("footprint")
def footprint() -> "list[Figure]":
    """CPU and memory of the executive's process, beside a bare node."""
    from tests.benchmarks import onboard

    log("footprint: 20 s of driving ...")
    return onboard.measure_footprint()


@benchmark(
    "mal --seconds 2",
    click.option(
        "--seconds",
        type=click.FloatRange(1.0),
        default=5.0,
        show_default=True,
        help="How long notifications are taken for each number of subscribers.",
    ),
    click.option(
        "--subscribers",
        type=click.IntRange(1),
        default=50,
        show_default=True,
        help="The most there are at once.",
    ),
)
def mal(seconds: float, subscribers: int) -> "list[Figure]":
    """Requests, notifications and a transfer on loopback, beside plain asyncio TCP."""
    from tests.benchmarks import mal

    log("MAL: requests, notifications, transfers ...")
    return mal.measure(duration_s=seconds, max_subscribers=subscribers)


@benchmark(
    "console --pages 3 --seconds 5",
    click.option("--pages", type=click.IntRange(1), default=10, show_default=True),
    click.option("--seconds", type=click.FloatRange(1.0), default=20.0, show_default=True),
)
def console(pages: int, seconds: float) -> "list[Figure]":
    """CPU of the console for its pages, and how soon a value is there, from a rover on MAL."""
    from tests.benchmarks import console

    return console.measure(pages, seconds, log)


@benchmark(
    "console-page --loads 3 --samples 50",
    click.option("--loads", type=click.IntRange(1), default=7, show_default=True),
    click.option("--samples", type=click.IntRange(2), default=100, show_default=True),
    click.option("--pages", type=click.IntRange(1), default=10, show_default=True),
    click.option("--seconds", type=click.FloatRange(1.0), default=20.0, show_default=True),
)
def console_page(loads: int, samples: int, pages: int, seconds: float) -> "list[Figure]":
    """Loading of the console's pages, values and pictures on them, in a browser; and `console`."""
    from tests.benchmarks import console, console_page

    return [
        *console_page.measure(loads, samples, log),
        *console.measure(pages, seconds, log),
    ]


@benchmark(
    "console-fleet --rovers 5 --seconds 5",
    click.option("--rovers", type=click.IntRange(1), default=20, show_default=True),
    click.option("--values", type=click.FloatRange(1.0), default=12.0, help="A second, of each."),
    click.option("--pages", type=click.IntRange(1), default=3, show_default=True),
    click.option("--seconds", type=click.FloatRange(1.0), default=20.0, show_default=True),
)
def console_fleet(rovers: int, values: float, pages: int, seconds: float) -> "list[Figure]":
    """CPU and memory of a console of many rovers, how soon all are found, a page with all."""
    from tests.benchmarks import console_fleet

    return console_fleet.measure(rovers, values, pages, seconds, log)


@benchmark(
    "console-soak --seconds 300 --commands 80",
    click.option("--values", type=click.FloatRange(1.0), default=10.0, help="A second."),
    click.option("--commands", type=click.IntRange(1), default=1000, show_default=True),
    click.option("--seconds", type=click.FloatRange(1.0), default=3600.0, show_default=True),
)
def console_soak(values: float, commands: int, seconds: float) -> "list[Figure]":
    """Heap, elements and CPU of a page of the console that stays open, in a browser."""
    from tests.benchmarks import console_soak

    return console_soak.measure(values, commands, seconds, log)


@benchmark("hostile --connections 200", count("--connections", 1000))
def hostile(count: int) -> "list[Figure]":
    """Memory, and the round trip of who was there first, while a thousand connections attack."""
    from tests.benchmarks import hostile

    log(f"hostile: {count} connections, three kinds of them ...")
    return hostile.measure(count)


@benchmark(
    "previews --motions 20 --controller turn-drive",
    count("--motions", 100),
    click.option(
        "--controller",
        "names",
        type=click.Choice([*OWN, "brick"]),
        default=["turn-drive", "mpc", "brick"],
        show_default=True,
        multiple=True,
        help="What drives; brick: MOCUP's. May be given several times.",
    ),
    SEED,
)
def previews(count: int, names: Sequence[str], seed: int) -> "list[Figure]":
    """Preview random motions and drive them in lock step: duration, end and energy."""
    from tests.benchmarks import previews

    return previews.measure(count, dict.fromkeys(names), seed, _settings(), log)


@benchmark(
    "saving --runs 5 --seeds 4",
    count("--runs", 50),
    click.option("--seeds", type=click.IntRange(1), default=4, show_default=True),
    SEED,
)
def saving(count: int, seeds: int, seed: int) -> "list[Figure]":
    """Failed runs: the minimal change of `rover whatif --save`, and that of all changes."""
    from tests.benchmarks import saving

    return saving.measure(count, seeds, seed, log)


@benchmark(
    "day --hours 2",
    click.option(
        "--hours", type=click.FloatRange(0.1, 24.0), default=24.0, show_default=True, help="Of it."
    ),
    SEED,
)
def day(hours: float, seed: int) -> "list[Figure]":
    """A day of operations in simulated time: how fast it passes."""
    from tests.benchmarks import simulated_day

    return simulated_day.measure(hours, seed)


@benchmark(
    "pairs --against HEAD~5 --rounds 11",
    click.option(
        "--against",
        metavar="COMMIT",
        help="The earlier one.  [default: the last in runs/bench-history.jsonl of this machine]",
    ),
    click.option("--rounds", type=click.IntRange(1), default=7, show_default=True),
)
def pairs(against: str | None, rounds: int) -> "list[Figure]":
    """Import, tick and lock step of this tree and of an earlier commit, in turn: what is slower?

    A ratio misses its goal where it is above 1 by more than its noise. The medians are appended to
    runs/bench-history.jsonl, with machine and commit.
    """
    from tests.benchmarks import pairs

    return pairs.measure(against, rounds, log)


@benchmark("lockstep")
def lockstep() -> "list[Figure]":
    """Speed and repeatability of the lock step."""
    from tests.benchmarks import lock_step

    log("lock step: six runs ...")
    return lock_step.measure()


@benchmark(
    "locomotion --controller turn-drive",
    click.option(
        "--goals",
        "path",
        type=click.Path(path_type=Path),
        help="Goals file: limits, and goals with best known times.  [default: 24 goals of our own]",
    ),
    click.option(
        "--controller",
        "names",
        type=click.Choice([*OWN, *COMPETITORS, "all"]),
        default=["turn-drive"],
        show_default=True,
        multiple=True,
        help="What drives; may be given several times.",
    ),
    click.option(
        "--max-ratio",
        "maximum",
        type=click.FloatRange(0.0, min_open=True),
        help="Greatest sum of times over best known.  [default: 1.45]",
    ),
    click.option(
        "--plots",
        type=click.Path(exists=True, file_okay=False, path_type=Path),
        help="A folder for a drawing of each controller's paths and times.",
    ),
)
def locomotion(
    path: Path | None, names: Sequence[str], maximum: float | None, plots: Path | None
) -> "list[Figure]":
    """Drive to goals in lock step: times against best known and a lower bound, true errors."""
    from tests.benchmarks import locomotion
    from tests.benchmarks.locomotion_drawing import draw

    goals = locomotion.read_goals(path or locomotion.OWN_GOALS)
    bound = maximum or (1.45 if path else 1.35)
    rows = []
    for name in (*OWN, *COMPETITORS) if "all" in names else dict.fromkeys(names):
        measured = locomotion.measure(goals, name, _settings(), log)
        rows.append(locomotion.figures(measured, bound))
        if plots is not None:
            log(f"drawn: {draw(measured, plots)}")
    return locomotion.side_by_side(rows)


@benchmark("bundle --bundles 2000", count("--bundles", 20_000, least=100))
def bundle(count: int) -> "list[Figure]":
    """Embedded bundle agents: durable throughput, recovery, memory, restart."""
    from tests.benchmarks import bundle

    log(f"bundles: {count} between two agents, 100000 in a queue ...")
    return bundle.measure(count)


@benchmark(
    "campaign --runs 20 --trivial 2000",
    click.option("--runs", type=click.IntRange(2), default=40, show_default=True,
                 help="Played by Dask and by a pool, in turn."),
    click.option("--trivial", type=click.IntRange(500), default=100_000, show_default=True,
                 help="Runs of no duration."),
)  # fmt: skip
def campaign(runs: int, trivial: int) -> "list[Figure]":
    """Campaigns: Dask beside a pool of processes, one worker and two, memory (about 8 minutes)."""
    from tests.benchmarks import campaign

    return campaign.measure(runs, trivial, log)


@benchmark("storm --commands 5000", count("--commands", 100_000), SEED)
def storm(count: int, seed: int) -> "list[Figure]":
    """Random commands, repeats, late arrivals and crashes, against the promises of the core."""
    from tests.stress import core_storm

    log(f"storm: {count} commands ...")
    return core_storm.measure(_settings(), count, seed, log)


@benchmark("power-cuts --kills 100", count("--kills", 2000), SEED)
def power_cuts(count: int, seed: int) -> "list[Figure]":
    """Power cuts with slow disks: does the ledger have all that was sent, and all that moved?"""
    from tests.stress import ledger_kills

    log(f"power cuts: {count} in each mix ...")
    return ledger_kills.measure(count, seed, log)


@benchmark("authority --interleavings 5000", count("--interleavings", 100_000), SEED)
def authority(count: int, seed: int) -> "list[Figure]":
    """Operators after one authority, over crashes: is there one holder, and does a stop act?"""
    from tests.stress import authority_storm

    log(f"authority: {count} interleavings ...")
    return authority_storm.measure(_settings(), count, seed, log)


@benchmark("navigation --drives 5", count("--drives", 50), SEED)
def navigation(count: int, seed: int) -> "list[Figure]":
    """Honest and lying navigations below: is EXECUTED true, does the rover stand at each end?"""
    from tests.stress import navigation_trial

    log(f"navigation: {count} drives for each behaviour, command and gate ...")
    return navigation_trial.measure(count, seed, log)


@benchmark(
    "mutants --number 14 --seed 2",
    count("--number", 100),
    SEED,
    click.option(
        "--recordings",
        type=click.Path(exists=True, file_okay=False, path_type=Path),
        help="A folder of recordings, which are made and left there if it is empty.",
    ),
)
def mutants(count: int, seed: int, recordings: Path | None) -> "list[Figure]":
    """Small changes of the core's rules: are they noticed by replaying recordings of it?

    Recordings are made of scenarios, campaigns and the tests of the core (more than an hour).
    """
    from tests.benchmarks import mutants

    return mutants.measure(count, seed, recordings, log)


@benchmark(
    "regressions --recordings 20",
    count("--recordings", 100),
    click.option(
        "--folder",
        type=click.Path(exists=True, file_okay=False, path_type=Path),
        help="A folder of recordings, which are made and left there if it is empty.",
    ),
)
def regressions(count: int, folder: Path | None) -> "list[Figure]":
    """Planted changes of settings and code: does a replay of recordings find each?"""
    from tests.benchmarks import regressions

    return regressions.measure(count, folder, log)


@benchmark("replays --runs 20", count("--runs", 500), SEED, OUTPUT)
def replays(count: int, seed: int, folder: Path | None) -> "list[Figure]":
    """Recorded runs with faults, crashes and random commands: does a replay decide the same?"""
    from tests.stress import replays

    log(f"replays: {count} runs ...")
    return replays.measure(count, seed, log, folder)


@benchmark("forks --forks 20", count("--forks", 200), SEED)
def forks(count: int, seed: int) -> "list[Figure]":
    """Forks of recordings: the same without a change, and with one as the scenario itself?"""
    from tests.benchmarks import forks

    log(f"forks: {count} recordings without a change, {count} changes ...")
    return forks.measure(count, count, seed, log)


@benchmark("preconditions --sites 2", count("--sites", 30))
def preconditions(count: int) -> "list[Figure]":
    """Relative commands, 15 % of them lost: contacts and pace with preconditions and without?"""
    from tests.benchmarks import preconditions

    log(f"preconditions: {count} sites ...")
    return preconditions.measure(count, log)


@benchmark("fuzz --messages 50000", count("--messages", 1_000_000), SEED)
def fuzz(count: int, seed: int) -> "list[Figure]":
    """Wrong messages against living providers: does any promise break? (about 4 minutes)."""
    from tests.stress import mal_fuzz

    log(f"fuzz: {count} messages ...")
    return mal_fuzz.measure(_settings(), count, seed, log)


@benchmark("bundle-fuzz --messages 10000", count("--messages", 300_000, least=100), SEED)
def bundle_fuzz(count: int, seed: int) -> "list[Figure]":
    """Wrong bundles, LTP segments and TCPCL streams against a node."""
    from tests.stress import bundle_fuzz

    log(f"bundle fuzz: {count} wrong messages ...")
    return bundle_fuzz.measure(count, seed, log)


@benchmark("recording-fuzz --recordings 500", count("--recordings", 20_000), SEED, OUTPUT)
def recording_fuzz(count: int, seed: int, folder: Path | None) -> "list[Figure]":
    """Damaged and hostile recordings against all who read them (some hours)."""
    from tests.stress import recording_fuzz

    log(f"recording fuzz: {count} wrong recordings ...")
    return recording_fuzz.measure(count, seed, log, folder)


@benchmark("mops-fuzz --messages 10000", count("--messages", 150_000, least=100), SEED)
def mops_fuzz(count: int, seed: int) -> "list[Figure]":
    """Texts of wrong MOPS strings against all who read them."""
    from tests.stress import mops_fuzz

    log(f"MOPS fuzz: {count} texts ...")
    return mops_fuzz.measure(_settings(), count, seed, log)


@benchmark("kills --kills 5", count("--kills", 50), SEED, OUTPUT)
def kills(count: int, seed: int, folder: Path | None) -> "list[Figure]":
    """Kill -9 for client, broker and executive: does the client's view equal the ledger?"""
    from tests.stress import kills

    log(f"kills: {count}, about {4 * count + 20} s ...")
    return kills.measure(count, seed, log, folder)


@benchmark("restarts --kills 5", count("--kills", 50), SEED)
def restarts(count: int, seed: int) -> "list[Figure]":
    """Kill -9 of the executive: how soon does it listen, and accept a command, again?"""
    from tests.benchmarks import restarts

    log(f"restarts: {count} kills ...")
    return restarts.measure(count, seed, log)


@benchmark(
    "busy --motions 4",
    click.option("--loops", type=click.IntRange(1), default=8, show_default=True),
    count("--motions", 10),
)
def busy(loops: int, count: int) -> "list[Figure]":
    """Motions beside busy loops, with raised priority and without: what is executed?"""
    from tests.benchmarks import busy

    log(f"busy: {count} motions four times ...")
    return busy.measure(loops, count, log)


@benchmark("dead-men --kills 5", count("--kills", 20), SEED)
def dead_men(count: int, seed: int) -> "list[Figure]":
    """Kill -9 for who commands a rover in motion: how soon does it stand? (about 15 minutes)."""
    from tests.stress import dead_men

    log(f"dead men: {count} kills of each kind ...")
    return dead_men.measure(count, seed, log)


@benchmark("bundle-kills --kills 20", count("--kills", 100), SEED, OUTPUT)
def bundle_kills(count: int, seed: int, folder: Path | None) -> "list[Figure]":
    """Kill -9 for two bundle agents: what was taken arrives, and once."""
    from tests.stress import bundle_kills

    log(f"bundle kills: {count} ...")
    return bundle_kills.measure(count, seed, log, folder)


@benchmark("campaign-kills --kills 5", count("--kills", 20), SEED)
def campaign_kills(count: int, seed: int) -> "list[Figure]":
    """Kill -9 for the workers of a campaign: every run is there, once, and the same."""
    from tests.stress import campaign_kills

    log(f"campaign kills: {count} ...")
    return campaign_kills.measure(count, seed, log)


@benchmark(
    "relay --messages 500 --kills 4",
    click.option(
        "--messages",
        type=click.IntRange(10),
        default=10_000,
        show_default=True,
        help="Commands up, and reports down.",
    ),
    click.option("--kills", type=click.IntRange(0), default=20, show_default=True),
    click.option("--loss", type=click.FloatRange(0.0, 0.9), default=0.1, show_default=True),
    SEED,
    OUTPUT,
)
def relay(messages: int, kills: int, loss: float, seed: int, folder: Path | None) -> "list[Figure]":
    """Orbiter and rover-relay killed over a bad link: is a message lost, or executed twice?"""
    from tests.stress import relay_storm

    log(f"relay: {messages} messages each way, {kills} kills ...")
    return relay_storm.measure(relay_storm.Plan(messages, kills, loss, seed), log, folder)


@benchmark(
    "relay-drain --commands 200 --samples 1 --refused 500",
    click.option("--commands", type=click.IntRange(1), default=3000, show_default=True),
    click.option("--samples", type=click.IntRange(1), default=20, show_default=True),
    click.option("--refused", type=click.IntRange(500), default=20_000, show_default=True),
)
def relay_drain(commands: int, samples: int, refused: int) -> "list[Figure]":
    """Commands by the relay after a contact begins, and a stop behind them."""
    from tests.benchmarks import relay_drain

    return relay_drain.measure(commands, samples, refused, log)


@benchmark("predicted-poses --sites 30", count("--sites", 9, least=2))
def predicted_poses(count: int) -> "list[Figure]":
    """Predicted poses of a rover behind 2.6, 10 and 300 s, on random sites (about 5 minutes)."""
    from tests.benchmarks import predicted_poses

    return predicted_poses.measure(count, log)


@click.group(invoke_without_command=True, commands=COMMANDS)
@JSON
@click.pass_context
def bench(context: click.Context, json_path: Path | None) -> None:
    """Measure the executive against its goals; without a name, everything (about 12 minutes).

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
        run([partial(MEASURES[name], **_defaults(name)) for name in WHOLE], json_path)


def _defaults(name: str) -> dict[str, Any]:
    params = bench.commands[name].make_context(name, []).params
    return {key: value for key, value in params.items() if key != "json_path"}
