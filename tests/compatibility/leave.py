"""Leaves what later versions must read: `python -m tests.compatibility.leave FOLDER`.

Run it once, at the release; nobody changes the folder afterwards.
"""

import asyncio
import json
import shutil
import tarfile
import tempfile
from contextlib import closing
from pathlib import Path
from typing import Any, Final

import click
import yaml

from adapters.mops import load_dictionary
from adapters.recording import RunFile
from executive.commands import Stop
from executive.record import Ledger
from executive.settings import config_folder, load_settings, unstructure
from tests.compatibility.interface import public_interface
from tests.compatibility.messages import encoded_reports, encoded_requests, mops_replies
from tests.compatibility.session import drive, work
from tests.suite import CHECKOUT
from tests.support.plans import PlanBench

INTERFACE: Final = "interface.json"
DATA: Final = "data.tar.xz"
MRS: Final = CHECKOUT / "adapters" / "mrs" / "spec" / "mrs.xml"


@click.command()
@click.argument("folder", type=click.Path(file_okay=False, path_type=Path))
def main(folder: Path) -> None:
    """Write the interface and the data of this version to a new FOLDER."""
    folder.mkdir(parents=True)
    (folder / INTERFACE).write_text(_json(public_interface()), encoding="utf-8")
    with tempfile.TemporaryDirectory() as scratch:
        data = Path(scratch)
        _fill(data)
        with tarfile.open(folder / DATA, "w:xz", preset=9) as archive:
            archive.add(data, arcname=".", filter=_anonymous)


def _fill(data: Path) -> None:
    answers = asyncio.run(work(data))
    (data / "http.json").write_text(_json(answers), encoding="utf-8")
    with closing(RunFile(data / "run.mcap")) as tape, tempfile.TemporaryDirectory() as aboard:
        drive(Path(aboard), tape)
    shutil.copytree(config_folder(), data / "config")
    (data / "config" / "complete.yaml").write_text(
        yaml.safe_dump(unstructure(load_settings("jackal"))), encoding="utf-8"
    )
    shutil.copy(MRS, data)
    (data / "requests.json").write_text(
        _json(encoded_requests(load_dictionary())), encoding="utf-8"
    )
    (data / "replies.json").write_text(_json(mops_replies(load_dictionary())), encoding="utf-8")
    with PlanBench(data / "stopped") as bench:
        bench.execute(Stop(), 1)
        bench.executive.simulate_crash()
    copy = shutil.copy(data / "rover" / "ledger.sqlite", data / "copy.sqlite")
    with closing(Ledger(Path(copy))) as ledger:
        (data / "reports.mal").write_bytes(encoded_reports(ledger.reports(1, count=1000)))
    Path(copy).unlink()


def _anonymous(member: tarfile.TarInfo) -> tarfile.TarInfo:
    member.uid = member.gid = member.mtime = 0
    member.uname = member.gname = ""
    return member


def _json(value: Any) -> str:
    return json.dumps(value, indent=1, sort_keys=True, ensure_ascii=False, default=str) + "\n"


if __name__ == "__main__":
    main()
