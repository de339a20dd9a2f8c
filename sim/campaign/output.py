"""The folder of a campaign: what it is of, its data set, its verdict; and whether it may go on."""

import json
import shutil
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path
from typing import Final

from adapters.process import StartError, exclusive
from executive.settings import SettingsError
from sim.campaign.draws import quantities
from sim.campaign.model import Campaign
from sim.campaign.runs import RunTable
from sim.campaign.worker import Software, fingerprint, software

FILE: Final = "campaign.json"
COPY: Final = "campaign.yaml"
LOCK: Final = "lock"


@dataclass(frozen=True, slots=True)
class CampaignFingerprint:
    """What decides over the bits of all runs.

    Attributes:
        title: of the campaign.
        drawn: digest of its scenarios' names, its seed and what varies.
        scenarios: digest of what is in those.
        software: that began the campaign.
    """

    title: str
    drawn: str
    scenarios: str
    software: Software

    @classmethod
    def of(cls, campaign: Campaign) -> "CampaignFingerprint":
        """Return that of a campaign, here and now."""
        drawn = repr((campaign.scenarios, campaign.seed, campaign.vary))
        prints = "".join(map(fingerprint, campaign.scenarios))
        return cls(campaign.title, _digest(drawn), _digest(prints), software())

    def obstacle(self, other: "CampaignFingerprint") -> str:
        """Return why another campaign's runs do not go with those of this one; empty if they do."""
        if self.software != other.software:
            return f"the software has changed: {self.software.differences(other.software)}"
        if self.drawn != other.drawn:
            return "the scenarios, the seed or what varies has changed"
        if self.scenarios != other.scenarios:
            return "a scenario has changed, or an asset or a world that it names"
        return ""


@contextmanager
def sole_writer(folder: Path) -> Iterator[None]:
    """Keep other campaigns out of a folder, which is made if it is not there.

    A folder that is something else is left alone: `open_output` refuses it.

    Raises:
        SettingsError: another campaign writes there, or it cannot be written.
    """
    with ExitStack() as held:
        if (folder / FILE).is_file() or _usable(folder):
            try:
                held.enter_context(exclusive(folder, LOCK))
            except StartError as error:
                if isinstance(error.__cause__, BlockingIOError):
                    raise SettingsError(
                        f"another campaign writes in {folder}: wait for it, or choose another --out"
                    ) from error
                raise SettingsError(f"{folder}: cannot be written ({error.__cause__})") from error
        yield


def open_output(folder: Path, campaign: Campaign, file: Path, *, resume: bool) -> RunTable:
    """Return the data set in the folder of a campaign, a new one or one to go on with.

    Whoever writes to it is its `sole_writer`.

    Args:
        folder: new or empty, if the campaign is not resumed.
        campaign: as its file says it.
        file: that file, of which a copy is kept.
        resume: whether runs that are there are kept.

    Raises:
        SettingsError: the folder cannot be used; the text says why, and what to do.
    """
    identity = CampaignFingerprint.of(campaign)
    begun = (folder / FILE).is_file()
    if resume and begun:
        obstacle = _read(folder / FILE).obstacle(identity)
        if obstacle:
            raise SettingsError(f"{folder} cannot be resumed: {obstacle}; choose another --out")
    elif not _usable(folder):
        way = "--resume goes on with it" if begun else "it holds no campaign"
        raise SettingsError(f"{folder} is not empty: {way}, or choose another --out")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not begun:
            shutil.copyfile(file, folder / COPY)
            text = json.dumps(asdict(identity), indent=1, ensure_ascii=False) + "\n"
            (folder / FILE).write_text(text, encoding="utf-8")
        return RunTable(folder, quantities(campaign))
    except OSError as error:
        raise SettingsError(f"{folder}: cannot be written ({error.strerror})") from error


def _usable(folder: Path) -> bool:
    """Return whether a folder is new or empty."""
    if not folder.is_dir():
        return not folder.exists()
    return all(each.name == LOCK for each in folder.iterdir())


def _read(path: Path) -> CampaignFingerprint:
    try:
        said = json.loads(path.read_text(encoding="utf-8"))
        return CampaignFingerprint(**{**said, "software": Software(**said["software"])})
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise SettingsError(f"{path}: is not that of a campaign ({error})") from error


def _digest(text: str) -> str:
    return sha256(text.encode()).hexdigest()
