"""Opens a page in a real browser without a network, and keeps what it looks like."""

import json
import os
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from tests.docs.pages import CHECKOUT

BROWSER: Final = shutil.which("chromium") or shutil.which("google-chrome")
REQUIRED: Final = "ROVER_CI" in os.environ
"""CI has a browser; elsewhere a test that needs one is skipped."""
ARTIFACTS: Final = CHECKOUT / "runs" / "artifacts"
LIMIT_S: Final = 120
_OPTIONS: Final = (
    "--headless=new",
    "--no-sandbox",  # it does not start as root otherwise
    "--disable-dev-shm-usage",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--hide-scrollbars",
    "--no-first-run",
    "--host-resolver-rules=MAP * ~NOTFOUND",
    "--enable-logging=stderr",
)


@dataclass(frozen=True, slots=True)
class Opened:
    """What came of opening a page.

    Attributes:
        console: what its console says: errors of scripts, violations of its policy.
        requests: what the page itself asked for over the network.
        document: the page as the browser has it.
    """

    console: list[str]
    requests: list[str]
    document: str


def open_page(page: Path, scratch: Path, size: tuple[int, int], picture: Path) -> Opened:
    """Open a page in a window of so many pixels, and write a picture of that."""
    assert BROWSER is not None
    picture.parent.mkdir(parents=True, exist_ok=True)
    log = scratch / "net.json"
    done = subprocess.run(
        [
            BROWSER,
            *_OPTIONS,
            f"--user-data-dir={scratch / 'profile'}",
            f"--log-net-log={log}",
            f"--window-size={size[0]},{size[1]}",
            f"--screenshot={picture}",
            "--dump-dom",
            page.as_uri(),
        ],
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        check=True,
    )
    events = [event.get("params", {}) for event in json.loads(log.read_text())["events"]]
    return Opened(
        console=[line for line in done.stderr.splitlines() if "CONSOLE" in line],
        # What the browser asks for of its own accord has no origin.
        requests=[
            params["url"]
            for params in events
            if "url" in params and params.get("initiator", "not an origin") != "not an origin"
        ],
        document=done.stdout,
    )
