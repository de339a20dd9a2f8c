"""A real node of NASA ION, started from files that are written here, beside any that runs already.

Syntax as in ION's manual pages ionrc(5), ionconfig(5), ltprc(5), bprc(5), ipnrc(5) of version 4.1,
and as in its demos/bench-ltp. Nothing is ever killed: that could lock what other nodes share.
"""

import asyncio
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager, suppress
from itertools import count
from pathlib import Path
from typing import Final

from tests.bundle.worlds import HERE

PROGRAMS: Final = (
    "ionadmin", "ionsecadmin", "ltpadmin", "bpadmin", "ipnadmin", "bpsource", "bpsink",
)  # fmt: skip
START_S: Final = 45.0
STOP_S: Final = 45.0
_SHARED_KEYS: Final = (0xEE08, 0xFF00)


PYTHON: Final = os.environ.get("ION_PYTHON", sys.executable)
_keys = count(66_000 + 100 * (os.getpid() % 1000), 10)


def missing() -> str | None:
    """Return what keeps this from running, if anything."""
    absent = [program for program in PROGRAMS if shutil.which(program) is None]
    if absent:
        return f"NASA ION is not on the PATH: {', '.join(absent)}"
    requested = [PYTHON, "-c", "import pyion"]
    environment = {**os.environ, "PYION_BP_VERSION": "BPv7"}
    if subprocess.run(requested, env=environment, capture_output=True, check=False).returncode:
        return f"{PYTHON} cannot import pyion; ION_PYTHON names one that can"
    return None


class IonNode:
    """A node with the endpoints ipn:N.1 and ipn:N.2, and LTP to some others.

    Args:
        folder: ION_NODE_LIST_DIR; the node has a folder of its own in it, named by its number.
        port: where its LTP engine listens.
        others: the LTP ports of its neighbours.
        durable: whether its database is in a file, and outlives it.
        max_octets: what is longer is fragmented; 0 for nothing.
    """

    def __init__(
        self, folder: Path, number: int, port: int, others: Mapping[int, int],
        durable: bool = False, max_octets: int = 0,
    ) -> None:  # fmt: skip
        self.number, self._port, self._others = number, port, others
        self._max_octets = max_octets
        self.list, self.home = folder, folder / str(number)
        self._key, self._flags = next(_keys), 7 if durable else 1

    @property
    def environment(self) -> dict[str, str]:
        return {**os.environ, "ION_NODE_LIST_DIR": str(self.list), "PYION_BP_VERSION": "BPv7"}

    def write(self) -> None:
        """Write its files."""
        self.home.mkdir(parents=True)
        for name, lines in self._files().items():
            (self.home / name).write_text("\n".join(lines) + "\n", encoding="ascii")

    async def start(self) -> None:
        for program, file in (
            ("ionadmin", "node.ionrc"),
            ("ionsecadmin", "node.ionsecrc"),
            ("ltpadmin", "node.ltprc"),
            ("bpadmin", "node.bprc"),
        ):
            await self.run(program, file, limit_s=START_S)

    async def stop_daemons(self) -> None:
        """Stop the daemons as ION's own ionstop does."""
        for program in ("bpadmin", "ltpadmin", "ionadmin"):
            await self.run(program, ".", limit_s=STOP_S)

    async def stop(self) -> None:
        """Stop the daemons, and give the shared memory back."""
        await self.stop_daemons()
        for key in (self._key, self._key + 5):
            subprocess.run(["ipcrm", "-M", str(key)], capture_output=True, check=False)

    async def cut_power(self) -> None:
        """End its processes at once, and remove the memory of every ION of this machine."""
        ended = [
            int(folder.name)
            for folder in Path("/proc").iterdir()
            if folder.name.isdigit() and _works_in(folder, self.home)
        ]
        for pid in ended:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        for row in Path("/proc/sysvipc/shm").read_text().splitlines()[1:]:
            if int(row.split()[0]) in (*_SHARED_KEYS, self._key, self._key + 5):
                subprocess.run(["ipcrm", "-M", row.split()[0]], capture_output=True, check=False)
        for semaphore in Path("/dev/shm").glob("sem.ion*"):
            semaphore.unlink(missing_ok=True)
        await asyncio.sleep(0)

    async def run(self, program: str, *arguments: str, limit_s: float, typed: str = "") -> None:
        """Run a program of ION's to its end; one that does not end is left alone, and said so."""
        script = self.home / f"{program}.typed"
        script.write_text(typed, encoding="ascii")
        # Daemons that it starts keep what it says into open: a pipe would never end.
        with (self.home / f"{program}.said").open("w+b") as printout, script.open("rb") as typing:
            process = subprocess.Popen(
                [program, *arguments], cwd=self.home, env=self.environment,
                stdin=typing, stdout=printout, stderr=subprocess.STDOUT,
            )  # fmt: skip
            try:
                await asyncio.to_thread(process.wait, limit_s)
            except subprocess.TimeoutExpired as error:
                raise AssertionError(f"{program} hangs and is left: {process.pid}") from error
            printout.seek(0)
            assert process.returncode == 0, f"{program} {arguments}: {printout.read().decode()}"

    @asynccontextmanager
    async def sink(self, service: int) -> AsyncIterator[Path]:
        """Have bpsink print what arrives at an endpoint, into a file; it ends by SIGINT."""
        printed = self.home / f"{service}.printed"
        with printed.open("wb") as file:
            process = subprocess.Popen(
                ["bpsink", f"ipn:{self.number}.{service}"], cwd=self.home, env=self.environment,
                stdin=subprocess.DEVNULL, stdout=file,
            )  # fmt: skip
        try:
            yield printed
        finally:
            process.send_signal(signal.SIGINT)
            await asyncio.to_thread(process.wait, STOP_S)

    def _files(self) -> dict[str, list[str]]:
        own = self.number
        return {
            "node.ionconfig": [
                f"wmKey {self._key}",
                f"sdrName rover{self._key}",
                "wmSize 50000000",
                f"configFlags {self._flags}",
                f"heapKey {self._key + 5}",
                "heapWords 5000000",
                f"pathName {self.home}",
            ],
            "node.ionrc": [
                f"1 {own} node.ionconfig",
                "s",
                "m horizon +0",
                f"a contact +0 +3600 {own} {own} 10000000",
                f"a range +0 +3600 {own} {own} 1",
                *(
                    line
                    for other in self._others
                    for line in (
                        f"a contact +0 +3600 {own} {other} 10000000",
                        f"a contact +0 +3600 {other} {own} 10000000",
                        f"a range +0 +3600 {own} {other} 1",
                        f"a range +0 +3600 {other} {own} 1",
                    )
                ),
            ],
            "node.ionsecrc": ["1"],
            "node.ltprc": [
                "1 64",
                *(
                    f"a span {other} 32 32 1300 10000 1 'udplso {HERE}:{port}'"
                    for other, port in self._others.items()
                ),
                f"s 'udplsi {HERE}:{self._port}'",
            ],
            "node.bprc": [
                "1",
                "m srmode traditional",
                "a scheme ipn 'ipnfw' 'ipnadminep'",
                *(f"a endpoint ipn:{own}.{service} q" for service in (1, 2)),
                "a protocol ltp",
                f"a induct ltp {own} ltpcli",
                *(f"a outduct ltp {other} ltpclo {self._max_octets}" for other in self._others),
                "r 'ipnadmin node.ipnrc'",
                "s",
            ],
            "node.ipnrc": [f"a plan {other} ltp/{other}" for other in self._others],
        }


def _works_in(process: Path, folder: Path) -> bool:
    """Return whether a process is a program of ION with this working folder."""
    programs = Path(shutil.which("bpadmin") or "").resolve().parent
    try:
        program = (process / "exe").readlink()
        return (process / "cwd").readlink() == folder and program.parent == programs
    except OSError:
        return False


@asynccontextmanager
async def ion_node(
    folder: Path, number: int, port: int, others: Mapping[int, int], max_octets: int = 0
) -> AsyncIterator[IonNode]:
    """Have a node of ION for the time of a with."""
    node = IonNode(folder, number, port, others, max_octets=max_octets)
    node.write()
    try:
        await node.start()
        yield node
    finally:
        await node.stop()
