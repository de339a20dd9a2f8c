"""Every command of the documentation is run, as it stands there, against a rover that runs."""

import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import urllib.request
import uuid
from collections.abc import Iterator
from contextlib import ExitStack, chdir, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from click.testing import CliRunner

from adapters.cli.main import main
from tests.conftest import port_of
from tests.docs.pages import CHECKOUT, PAGES, Line, as_shipped, blocks, lines
from tests.support.certificates import authority_for
from tests.support.patience import shipped_config
from tests.support.processes import Running, run_to_end

BIN = Path(sys.executable).parent
INTERFACE = "adapters/mrs/spec/mrs.xml"
LIMIT_S = 600
IDLE_LIMIT_S = 3600
"""The suite runs the tests without a rover while a processor is idle: they may wait for long."""
START = "./rover demo --no-session"
STARTS = (START, f"{START} --relay")
"""What pages start. Who has the second has the first."""
KNOWN_PORTS = ("21000", "21001", "21081", "21100", "21500")
OTHER_TESTS = {
    "./rover demo --stay": "tests/demo plays it",
    "./rover test": "is what runs this",
}
CONSOLE = ".venv/bin/rover-console"
STAYS = {
    START: "Ctrl-C ends it.",
    "./rover link": "listens at",
    "./rover watch": "? rover",
    "./rover files watch": "watching the files",
    ".venv/bin/rover-sim": "stands in world",
    ".venv/bin/rover-executive": "listens at",
    CONSOLE: "http://127.0.0.1:",
}
"""Commands that stay until Ctrl-C, and what they say once they are ready."""

NO_ROVER = tuple(
    f"./rover {command} "
    for command in (
        "scenario",
        "calibrate",
        "campaign",
        "replay",
        "plot",
        "whatif",
        "bag",
        "log --file",
        "plan check",
        "plan prove",
        "why --file",
        "watch --file",
    )
)
"""Commands that need no rover that runs, and no real time."""
HERE = re.compile(
    r"\./rover (authority|bag|calibrate|campaign|command|doctor|files (?!watch)|log|moveTo|plan"
    r"|plot|preview|replay|resume|robot|scenario|services|status|stop|tree"
    r"|watch --file|whatif|why)\b[^|>]*"
)
"""Commands that are run in this process: another imports for longer than they take."""
WITH_FILES = {CHECKOUT / "docs" / name for name in ("campaigns.md", "above-nav2.md")}
"""Whose commands are run with their files by `test_campaigns.py` and `test_navigation_pages.py`."""

pytestmark = pytest.mark.slow


@dataclass(frozen=True, slots=True)
class Desk:
    """A folder that looks like the checkout, and where its rovers are.

    Attributes:
        proposed: the commands that the demonstration proposes once its rover stands there.
        console: the address of its console.
    """

    folder: Path
    ports: dict[str, int]
    proposed: tuple[str, ...] = ()
    console: str = ""

    def here(self, text: str) -> str:
        """Return a text with the commands, ports and addresses of this desk."""
        for known, port in self.ports.items():
            text = text.replace(known, str(port))
        text = text.replace(INTERFACE, str(CHECKOUT / INTERFACE))
        return text.replace(".venv/bin/", f"{BIN}/").replace("./rover ", f"{BIN}/rover ")

    def run(self, line: Line) -> None:
        if line.text.startswith("openssl ") and shutil.which("openssl") is None:
            keys = self.folder / "runs" / "keys"  # a bare machine does not have openssl
            authority_for(keys, "rover", "moe")
            return
        if HERE.fullmatch(line.text):
            status, output = self.run_here(line.text)
            assert status == line.status, f"{line.text}: {output}"
            return
        done = subprocess.run(
            self.here(line.text),
            shell=True,
            cwd=self.folder,
            capture_output=True,
            text=True,
            timeout=IDLE_LIMIT_S,
            check=False,
        )
        assert done.returncode == line.status, f"{line.text}: {done.stdout}{done.stderr}"

    def run_here(self, text: str) -> tuple[int, str]:
        """Run a command without a process of its own; return its exit status and its output."""
        _, *arguments = shlex.split(self.here(text))
        with chdir(self.folder), pytest.MonkeyPatch.context() as patch:
            if text.startswith(NO_ROVER):  # the rover that runs beside it is patient
                patch.setenv("ROVER_CONFIG", str(CHECKOUT / "config"))
            done = CliRunner().invoke(main, arguments, prog_name="rover", catch_exceptions=False)
        return done.exit_code, done.output

    def until_located(self) -> None:
        """Wait as long as a person takes to go to the next terminal: ROS has to find together."""
        requested = f"{BIN}/rover status --json --to 127.0.0.1:{self.ports['21001']}"
        for _ in range(LIMIT_S):
            reported = json.loads(subprocess.check_output(requested.split(), timeout=LIMIT_S))
            if reported["parameters"]["POS_X"]["value"] is not None:
                return
        raise AssertionError("the executive never heard where its rover is")

    @contextmanager
    def staying(self, text: str, ready: str) -> Iterator[Running]:
        """Run a command that stays; it must end well by Ctrl-C."""
        log = self.folder / f"{uuid.uuid4().hex}.log"
        process = Running(log, *self.here(text).split(), cwd=self.folder)
        try:
            process.output(re.escape(ready))
            yield process
        finally:
            status = process.end(signal.SIGINT)
        assert status in (0, 130), f"{text}: {process.text}"


def _stays(text: str) -> str | None:
    """Return what a command says once it is ready, if it stays."""
    if "--once" in text or "--file" in text:
        return None
    return next((ready for start, ready in STAYS.items() if text.startswith(start)), None)


def laid_out(folder: Path, config: Path = CHECKOUT / "config") -> Path:
    """Return a folder, with a configuration in it."""
    shipped_config(folder, config)
    return folder


@pytest.fixture(scope="module")
def desk(
    module_ros_domain: int, patient: Path, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Desk]:
    """Give a desk with the rover that the pages start."""
    assert os.environ["ROS_DOMAIN_ID"] == str(module_ros_domain)
    folder = laid_out(tmp_path_factory.mktemp("desk"), patient)
    desk = Desk(folder, {known: port_of(module_ros_domain) for known in KNOWN_PORTS})
    orbiter = folder / "config" / "mops" / "orbiter.yaml"
    orbiter.write_text(desk.here(orbiter.read_text()))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROVER_URI", f"127.0.0.1:{desk.ports['21000']}")
        patch.setenv("ROVER_CONFIG", str(folder / "config"))
        patch.setenv("ROVER_DATA", str(folder / "data"))
        patch.setenv("ROVER_CONSOLE_PORT", "0")  # not where a page of somebody else looks
        with desk.staying(STARTS[-1], STAYS[START]) as demo:
            proposed = re.findall(
                r"^  (?:ROS_DOMAIN_ID=\d+ )?(\./rover .*)", demo.text, re.MULTILINE
            )
            console, _ = re.findall(r"http://127.0.0.1:\d+/", demo.text)
            yield replace(desk, proposed=tuple(proposed), console=console)


def to_run(page: Path) -> list[Line]:
    """Return the command lines of a page that are run here."""
    return [line for line in lines(page) if line.text not in as_shipped(page)]


def pages(no_rover: bool) -> list[Path]:
    """Return the pages with commands that need no rover, or the others."""
    typed = {page: [line.text.startswith(NO_ROVER) for line in to_run(page)] for page in PAGES}
    return [
        page
        for page, without in typed.items()
        if without and all(without) == no_rover and page not in WITH_FILES
    ]


@pytest.mark.parametrize("page", pages(no_rover=True), ids=lambda page: page.stem)
def test_commands_without_a_rover_act_as_documented(page: Path, tmp_path: Path) -> None:
    desk = Desk(laid_out(tmp_path), {})
    for line in to_run(page):
        desk.run(line)


@pytest.mark.busy
@pytest.mark.ros
def test_a_rover_that_stays_obeys_a_second_terminal(desk: Desk) -> None:
    assert "./rover watch" in desk.proposed
    for text in desk.proposed:
        desk.run(Line(f"{text} --once" if text == "./rover watch" else text, 0))
    assert " IDLE " in run_to_end(BIN / "rover", "watch", "--once").stdout
    with urllib.request.urlopen(f"{desk.console}api/dictionary", timeout=LIMIT_S) as answer:
        assert list(json.load(answer)["assets"]) == ["jackal"]
    second = run_to_end(BIN / "rover", "demo", "--no-session", "--out", desk.folder / "second")
    assert second.returncode == 1
    assert "is in use, probably by another rover" in second.stderr


@pytest.mark.busy
@pytest.mark.ros
@pytest.mark.parametrize("page", pages(no_rover=False), ids=lambda page: page.stem)
def test_commands_act_as_documented(page: Path, desk: Desk) -> None:
    with ExitStack() as terminals:
        for line in to_run(page):
            if line.text in OTHER_TESTS or line.text in STARTS:
                continue
            ready = _stays(line.text)
            if ready is None:
                desk.run(line)
            else:
                terminals.enter_context(desk.staying(line.text, ready))
                if "rover-executive" in line.text and "--certificate" not in line.text:
                    desk.until_located()


def printed(script: str, desk: Desk) -> str:
    """Return what a piece of Python prints."""
    program = (sys.executable, "-c", desk.here(script))
    ran = run_to_end(*program, cwd=desk.folder, PYTHONPATH=str(CHECKOUT))
    assert ran.returncode == 0, ran.stderr
    return ran.stdout


@pytest.mark.busy
@pytest.mark.ros
def test_python_commands_a_rover(desk: Desk) -> None:
    (script,) = blocks(CHECKOUT / "docs" / "command-a-rover.md", "python")
    reported = printed(script, desk)
    assert reported.count("Stage.EXECUTED") == 1
    assert "Pose(frame='odom'" in reported


@pytest.mark.busy
@pytest.mark.ros
def test_python_of_a_notebook(desk: Desk) -> None:
    page = CHECKOUT / "docs" / "python-api.md"
    commanding, reading = blocks(page, "python")
    assert "\nTrue\n" in printed(commanding, desk)
    for line in lines(page):
        desk.run(line)
    assert re.search("FAILED +the left wheels do not follow", printed(reading, desk))


@pytest.mark.busy
@pytest.mark.ros
def test_python_queries_a_console(desk: Desk) -> None:
    page = CHECKOUT / "docs" / "console.md"
    (script,) = blocks(page, "python")
    console = next(line.text for line in lines(page) if line.text.startswith(CONSOLE))
    with desk.staying(console, STAYS[CONSOLE]):
        reported = printed(script, desk)
    assert re.search(
        r"executed \['SENT', ('ACKNOWLEDGED', )?'RECEIVED', 'ACCEPTED', 'STARTED', ", reported
    )
    assert "('POS_X', " in reported


@pytest.mark.busy
@pytest.mark.ros
def test_python_fetches_a_picture(desk: Desk) -> None:
    (script,) = blocks(CHECKOUT / "docs" / "fetch-a-picture.md", "python")
    reported = printed(script, desk)
    assert "STORED pictures/LAB-2-" in reported
    assert "True ['commandId', 'POS_X'" in reported


@pytest.mark.busy
@pytest.mark.ros
def test_a_client_of_ones_own_commands_a_rover(desk: Desk) -> None:
    by_specification, by_octets = blocks(CHECKOUT / "docs" / "own-client.md", "python")
    reported = printed(by_specification, desk)
    assert "EXECUTED" in reported
    assert "at 0.5" in reported or "at 0.4" in reported
    assert printed(by_octets, desk) == "SUBMIT_ACK\n"
    desk.run(Line("./rover command resume", 0))


def test_all_blocks_not_run_here_are_on_the_front_page() -> None:
    assert set(OTHER_TESTS) <= {line.text for line in lines(CHECKOUT / "README.md")}
