"""The command `rover campaign`: thousands of runs of scenarios, and one verdict."""

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click
from click.shell_completion import CompletionItem

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from distributed import Client
    from rich.console import Console

    from sim.campaign.model import Campaign
    from sim.campaign.runs import RunTable
    from sim.campaign.verdict import CampaignVerdict

PIPE_WIDTH: Final = 240
NOT_USABLE: Final = 2
INTERRUPTED: Final = 130


def _complete(_: click.Context, __: click.Parameter, begun: str) -> list[CompletionItem]:
    """Complete the name of a campaign, or the path of a file."""
    from executive.settings import config_folder, names_in

    names = [name for name in names_in(config_folder() / "campaigns") if name.startswith(begun)]
    # In this order: bash drops names before the entry for files.
    return [CompletionItem(begun, type="file"), *map(CompletionItem, names)]


@click.command()
@click.argument("file", required=False, shell_complete=_complete)
@click.option("--list", "listed", is_flag=True, help="List the named campaigns.")
@click.option("--runs", type=click.IntRange(1), help="Number of runs.  [default: as in the file]")
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help="Output folder, new or empty.  [default: runs/campaign-NAME]",
)
@click.option("--resume", is_flag=True, help="Reuse the runs in that folder, execute the others.")
@click.option(
    "--jobs",
    type=click.IntRange(1),
    help="Number of parallel runs on this computer.  [default: one on each core]",
)
@click.option(
    "--saved",
    type=click.IntRange(0),
    default=100,
    show_default=True,
    help="Number of failed runs with all their files saved.",
)
@click.option("--scheduler", metavar="ADDRESS", help="Address of the scheduler of a Dask cluster.")
def campaign(
    file: str | None,
    listed: bool,
    runs: int | None,
    out: Path | None,
    resume: bool,
    jobs: int | None,
    saved: int,
    scheduler: str | None,
) -> None:
    """Execute scenarios thousands of times with drawn values, and judge them all together.

    FILE is YAML, or the name of a campaign in config/campaigns. It names scenarios, their varied
    quantities, the number of runs, and the criteria over all of them: success rates and quantiles,
    each with its confidence. docs/campaigns.md explains how to write one.

    Completed runs survive Ctrl-C; --resume continues. The folder gets a report as an HTML
    page, JUnit XML, and a Parquet data set: a row per run, with the command that repeats it.

    \b
    Examples:
      rover campaign normal
      rover campaign my-campaign.yaml --runs 200 --out first-try
      rover campaign my-campaign.yaml --out first-try --resume --runs 1000
      rover campaign faults --scheduler tcp://scheduler:8786
      rover campaign --list

    \b
    Exit status:
      0    all criteria are met
      1    a criterion is not met, or too few runs decide it
      2    the file cannot be used, a condition matches no run, or the cluster is lost
      130  interrupted by Ctrl-C; completed runs are saved
    """
    from adapters.process import require
    from executive.settings import SettingsError

    if jobs is not None and scheduler is not None:
        raise click.UsageError("--jobs is for this computer; with --scheduler, the cluster decides")
    for package in ("pyarrow", "distributed", "pandas", "scipy", "jinja2"):
        require(package)
    try:
        if listed:
            _list()
        elif file is None:
            raise click.UsageError("name a FILE; rover campaign --list lists the named ones")
        else:
            from sim.campaign.session import sole_writer

            folder = out or _default_folder(file)
            again = _again(file, folder, runs=runs, jobs=jobs, saved=saved, scheduler=scheduler)
            with sole_writer(folder):
                sys.exit(_play(file, runs, folder, resume, saved, _cluster(scheduler, jobs), again))
    except SettingsError as error:
        click.echo(f"Error: {error}", err=True)
        sys.exit(NOT_USABLE)


def _list() -> None:
    from executive.settings import names_in
    from sim.campaign.reading import campaign_folder, load_campaign

    for name in names_in(campaign_folder()):
        click.echo(f"{name:<16}{load_campaign(name).title}")


def _default_folder(file: str) -> Path:
    return Path("runs") / f"campaign-{Path(file).stem}"


def _again(file: str, out: Path, **options: object) -> str:
    """Return the command that resumes a campaign, from the same folder."""
    given = [(f"--{name}", str(value)) for name, value in options.items() if value is not None]
    parts = [word for option in given for word in option]
    return shlex.join(["rover", "campaign", file, "--out", str(out), "--resume", *parts])


def _play(
    file: str,
    runs: int | None,
    out: Path,
    resume: bool,
    max_saved: int,
    cluster: "AbstractContextManager[Client]",
    again: str,
) -> int:
    """Execute a campaign to its verdict and return the exit status."""
    from functools import partial

    from rich.console import Console

    from sim.campaign.cluster import ClusterError, results
    from sim.campaign.progress import ProgressBar, show
    from sim.campaign.reading import campaign_path, load_campaign
    from sim.campaign.session import CampaignSession, open_output, save_failed_runs
    from sim.campaign.verdict import judge
    from sim.campaign.worker import run_and_archive, run_job

    console = Console(width=None if sys.stdout.isatty() else PIPE_WIDTH, highlight=False)
    loaded = load_campaign(file, runs)
    data = open_output(out, loaded, campaign_path(file), resume=resume)
    if isinstance(loaded.runs, int) and loaded.runs % loaded.combinations:
        text = (
            f"{loaded.runs} runs cover some of the {loaded.combinations} combinations of scenarios"
        )
        click.echo(f"Warning: {text} and grids more often than others", err=True)
    try:
        with cluster as client, ProgressBar(console) as bar:
            CampaignSession(loaded, data, partial(results, client, run_job), bar).run_missing()
            unlike = save_failed_runs(
                loaded, data, partial(results, client, run_and_archive), out, max_saved, bar
            )
        for run in unlike:
            click.echo(f"Warning: run {run}, repeated, was not identical bit for bit", err=True)
        verdict = judge(loaded, data)
        show(console, verdict)
        _write_reports(console, loaded, data, verdict, out)
    except ClusterError as error:
        click.echo(f"Error: {error}\n{_resume_hint(len(data.numbers()), out, again)}", err=True)
        return NOT_USABLE
    except KeyboardInterrupt:
        click.echo(f"Interrupted. {_resume_hint(len(data.numbers()), out, again)}", err=True)
        return INTERRUPTED
    if verdict.empty:
        click.echo("Error: a criterion matches no run", err=True)
        return NOT_USABLE
    return 0 if verdict.passed else 1


def _write_reports(
    console: "Console", loaded: "Campaign", data: "RunTable", verdict: "CampaignVerdict", out: Path
) -> None:
    """Write verdict, report and JUnit, and print the folder."""
    from executive.settings import SettingsError
    from sim.campaign.report import write_campaign_junit, write_report

    try:
        verdict.write(out)
        with console.status("repeating the worst runs for the report"):
            page = write_report(out, loaded, data, verdict)
        junit = write_campaign_junit(out, loaded, data, verdict)
    except OSError as error:
        raise SettingsError(f"{out}: cannot be written ({error.strerror})") from error
    console.print(f"written to {out}: {page.name}, {junit.name}, and all runs", markup=False)


def _cluster(scheduler: str | None, jobs: int | None) -> "AbstractContextManager[Client]":
    from sim.campaign.cluster import cluster_at, cores, local_cluster

    return local_cluster(jobs or cores()) if scheduler is None else cluster_at(scheduler)


def _resume_hint(runs: int, out: Path, again: str) -> str:
    return f"{runs} runs are saved in {out}; resume with: {again}"
