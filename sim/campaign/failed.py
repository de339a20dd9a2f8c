"""What failed runs leave: they are played once more, where the others were, and all is kept.

A run costs less than what it would leave; so it is told by its row, until it fails.
"""

import io
import zipfile
from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from pathlib import Path
from shutil import rmtree
from typing import Final, Protocol

from executive.settings import SettingsError
from sim.campaign.draws import draw
from sim.campaign.model import Campaign
from sim.campaign.runs import Runs
from sim.campaign.session import job_of
from sim.campaign.worker import Job, Kept, NotPlayed

FOLDER: Final = "failed"
"""Below the folder of a campaign: a folder for each of its failed runs."""


class Watcher(Protocol):
    """Who hears how it goes."""

    def keep(self, total: int) -> None:
        """Hear how many runs there are to be kept."""

    def kept(self) -> None:
        """Hear that one more is."""


def keep_failed(
    campaign: Campaign,
    runs: Runs,
    play: Callable[[Iterable[Job]], Iterator[Kept | NotPlayed]],
    folder: Path,
    most: int,
    watcher: Watcher,
) -> list[int]:
    """Keep what failed runs leave, of those that are not kept yet.

    Args:
        campaign: that they are of.
        runs: all of it.
        play: plays jobs, in whatever order.
        folder: of the campaign.
        most: how many are kept, the first.
        watcher: hears how it goes.

    Returns:
        The runs that were not alike bit for bit when they were played once more.

    Raises:
        SettingsError: a run cannot be played any more, or not be written.
    """
    digests = {run.run: run.digest for run in islice(runs.read(failed=True), most)}
    missing = [run for run in digests if not folder_of(folder, run).exists()]
    watcher.keep(len(missing))
    unlike = []
    for result in play(job_of(draw(campaign, run)) for run in missing):
        if isinstance(result, NotPlayed):
            raise SettingsError(f"run {result.run} cannot be played once more: {result.why}")
        if result.digest != digests[result.run]:
            unlike.append(result.run)
        _unpack(result.archive, folder_of(folder, result.run))
        watcher.kept()
    return sorted(unlike)


def folder_of(folder: Path, run: int) -> Path:
    """Return where a failed run is kept, below the folder of its campaign."""
    return folder / FOLDER / f"run-{run:06d}"


def _unpack(archive: bytes, place: Path) -> None:
    """Write a zip file into a folder, which is there as a whole or not at all."""
    unfinished = place.with_suffix(".unfinished")
    rmtree(unfinished, ignore_errors=True)
    try:
        with zipfile.ZipFile(io.BytesIO(archive)) as files:
            files.extractall(unfinished)
        unfinished.rename(place)
    except OSError as error:
        raise SettingsError(f"{place}: cannot be written ({error.strerror})") from error
