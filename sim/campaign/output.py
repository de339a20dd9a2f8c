"""A campaign's output folder: `open_output` creates it or checks that it can be resumed."""

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
    """Inputs that determine the bits of all runs.

    Attributes:
        drawn: digest of its scenarios' names, its seed and its varied quantities.
        scenarios: digest of the scenarios' contents.
        software: software that began the campaign.
    """

    title: str
    drawn: str
    scenarios: str
    software: Software

    @classmethod
    def of(cls, campaign: Campaign) -> "CampaignFingerprint":
        """Return the fingerprint of a campaign with the present files and software."""
        drawn = repr((campaign.scenarios, campaign.seed, campaign.vary))
        prints = "".join(map(fingerprint, campaign.scenarios))
        return cls(campaign.title, _digest(drawn), _digest(prints), software())

    def mismatch(self, other: "CampaignFingerprint") -> str:
        """Return why another campaign's runs do not fit this one's; empty if they do."""
        if self.software != other.software:
            return f"the software has changed: {self.software.differences(other.software)}"
        if self.drawn != other.drawn:
            return "the scenarios, the seed or the varied quantities have changed"
        if self.scenarios != other.scenarios:
            return "a scenario has changed, or an asset or a world that it names"
        return ""


@contextmanager
def sole_writer(folder: Path) -> Iterator[None]:
    """Lock a folder against other campaigns; it is created if missing.

    A folder with other content is not changed: `open_output` refuses it.

    Raises:
        SettingsError: another campaign writes to it, or it cannot be written.
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
    """Return the data set in the folder of a campaign, a new one or one to resume.

    The writer must hold `sole_writer`.

    Args:
        folder: new or empty, unless the campaign is resumed.
        campaign: content of its file.
        file: the file, which is copied.
        resume: whether existing runs are reused.

    Raises:
        SettingsError: the folder cannot be used; the text gives the cause and the remedy.
    """
    identity = CampaignFingerprint.of(campaign)
    begun = (folder / FILE).is_file()
    if resume and begun:
        obstacle = _read(folder / FILE).mismatch(identity)
        if obstacle:
            raise SettingsError(f"{folder} cannot be resumed: {obstacle}; choose another --out")
    elif not _usable(folder):
        remedy = "--resume continues it" if begun else "it has no campaign"
        raise SettingsError(f"{folder} is not empty: {remedy}, or choose another --out")
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
        content = json.loads(path.read_text(encoding="utf-8"))
        return CampaignFingerprint(**{**content, "software": Software(**content["software"])})
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise SettingsError(f"{path} is not a campaign's file ({error})") from error


def _digest(text: str) -> str:
    return sha256(text.encode()).hexdigest()
