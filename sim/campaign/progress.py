"""`ProgressBar` of a campaign on the terminal while it runs; `show` prints its verdict."""

from typing import Final

from rich.console import Console
from rich.markup import escape
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table
from rich.text import Text

from sim.campaign.runs import CampaignRun
from sim.campaign.verdict import CampaignVerdict, CriterionStatus, clopper_pearson

FIRST_FAILURES: Final = 5
_MARKS: Final = {
    CriterionStatus.PASSED: "[green]passed[/]",
    CriterionStatus.FAILED: "[red]FAILED[/]",
    CriterionStatus.UNDECIDED: "[yellow]UNDECIDED[/]",
    CriterionStatus.EMPTY: "[red]ERROR[/]",
}


class _Rate(ProgressColumn):
    """Success rate of the completed runs, with its interval.

    SciPy needs 2 ms for it: it is computed when the bar is drawn, and not for each run.
    """

    def render(self, task: Task) -> Text:
        """Return it as text; empty for the bar of saved failed runs."""
        runs, succeeded = int(task.completed), task.fields.get("succeeded")
        if succeeded is None or not runs:
            return Text("" if succeeded is None else "none yet")
        interval = clopper_pearson(succeeded, runs)
        bounds = f"{interval.low:.1%} .. {interval.high:.1%}"
        return Text(f"{succeeded / runs:.1%} succeed ({bounds})")


class ProgressBar(Progress):
    """Shows the number of runs, their success rate, and the remaining time."""

    def __init__(self, console: Console) -> None:
        super().__init__(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            _Rate(),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            console=console,
        )
        self._runs = self.add_task("runs", total=None, succeeded=0)
        self._save_task = self._runs
        self._succeeded = self._failed = 0

    def expect(self, total: int, done: int, succeeded: int) -> None:
        """Show the planned number of runs."""
        self._succeeded = succeeded
        self.update(self._runs, total=total, completed=done, succeeded=succeeded)

    def on_run(self, run: CampaignRun) -> None:
        """Show one more run; the first failed ones with their number and cause."""
        self._succeeded += run.passed
        if not run.passed:
            self._failed += 1
            self._print_failure(run)
        self.update(self._runs, advance=1, succeeded=self._succeeded)

    def begin_saving(self, total: int) -> None:
        """Show the number of failed runs to save."""
        if total:
            self._save_task = self.add_task("failed runs saved", total=total)

    def on_saved(self) -> None:
        """Show that one more is saved."""
        self.advance(self._save_task)

    def _print_failure(self, run: CampaignRun) -> None:
        if self._failed <= FIRST_FAILURES:
            self.console.print(f"run {run.run} fails: {escape(run.failed_findings[0])}")
            self.console.print(f"  [dim]{escape(run.command)}[/]", soft_wrap=True)
        elif self._failed == FIRST_FAILURES + 1:
            self.console.print("[dim]more runs fail; the data set has them all[/]")


def show(console: Console, verdict: CampaignVerdict) -> None:
    """Print a verdict."""
    console.print(f"[bold]{escape(verdict.title)}[/]")
    table = Table(box=None, pad_edge=False, header_style="dim")
    for column in ("", "criterion", "observed"):
        table.add_column(column, overflow="fold")
    for each in verdict.judged:
        table.add_row(_MARKS[each.judgement], escape(each.criterion), escape(each.text))
    console.print(table)
    console.print(
        f"{verdict.succeeded} of {verdict.runs} runs succeed:"
        f" {verdict.low:.4g} .. {verdict.high:.4g} with confidence 0.95"
    )
    for note in verdict.notes:
        console.print(f"[yellow]Note:[/] {escape(note)}")
