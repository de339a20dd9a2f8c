"""The README's commands on a bare Debian: each release of `SUITES` as a root made by debootstrap.

It needs root, debootstrap, Debian's mirror and the package index; `rover test --stress` runs it. A
root has Debian's base and python3 with venv; what reaches the package index here, such as proxies
and certificates, is copied into it.
"""

import os
import re
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Final

import pytest

from tests.support.wheel import CHECKOUT

SUITES: Final = {"bookworm": "3.11", "trixie": "3.13", "forky": "3.14"}
"""Debian's releases, each with the version of its Python."""
COPIED: Final = ("/etc/pip.conf", "/etc/resolv.conf", "/etc/ssl/certs/ca-certificates.crt")
MIRROR: Final = re.compile(r"^(?:URIs: |deb (?:\[.*?\] )?)(\S+/debian)/?(?: |$)", re.MULTILINE)
PASSED_ON: Final = re.compile(r"(?i)(https?|no)_proxy|pip_.*|ssl_cert_.*|requests_ca_bundle")
LIMIT_S: Final = 1800.0
pytestmark = [
    pytest.mark.skipif(os.geteuid() != 0, reason="debootstrap and chroot need root"),
    pytest.mark.skipif(shutil.which("debootstrap") is None, reason="apt install debootstrap"),
]


def mirror() -> str:
    """Return the mirror that apt uses here."""
    listed = [*Path("/etc/apt").glob("sources.list*"), *Path("/etc/apt/sources.list.d").glob("*")]
    text = "\n".join(path.read_text() for path in listed if path.is_file())
    found = MIRROR.search(text)
    return found[1] if found else "http://deb.debian.org/debian"


@contextmanager
def mounted(root: Path) -> Iterator[None]:
    """Give a root what programs expect of a kernel."""
    with ExitStack() as mounts:
        for options, name in (
            (("-t", "proc", "proc"), "proc"),
            (("-t", "tmpfs", "tmpfs"), "dev/shm"),
        ):
            subprocess.run(("mount", *options, root / name), check=True)
            mounts.callback(subprocess.run, ("umount", "--lazy", root / name), check=True)
        yield


@pytest.fixture(params=SUITES)
def root(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Path]:
    root = tmp_path / request.param
    command = ["debootstrap", "--variant=minbase", "--include=python3,python3-venv,ca-certificates"]
    known = Path("/usr/share/debootstrap/scripts", request.param).exists()
    done = subprocess.run(
        [*command, request.param, str(root), mirror(), request.param if known else "sid"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, f"{done.stdout[-2000:]}{done.stderr[-2000:]}"
    for name in filter(os.path.isfile, COPIED):
        shutil.copyfile(name, f"{root}{name}")
    home = root / "rover"
    home.mkdir()
    files = subprocess.check_output(("git", "ls-files", "-z"), cwd=CHECKOUT, text=True).split("\0")
    for name in filter(None, files):
        (home / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(CHECKOUT / name, home / name)
    with mounted(root):
        yield root


def typed(root: Path, command: str) -> subprocess.CompletedProcess[str]:
    """Run a command in the checkout of a root."""
    passed = {name: value for name, value in os.environ.items() if PASSED_ON.fullmatch(name)}
    path = "/usr/sbin:/usr/bin:/sbin:/bin"
    return subprocess.run(
        ("chroot", str(root), "sh", "-c", f"cd /rover && {command}"),
        env={**passed, "PATH": path, "HOME": "/root", "LANG": "C.UTF-8"},
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        check=False,
    )


def test_the_commands_of_the_front_page_work(root: Path) -> None:
    version = typed(root, "python3 --version").stdout
    assert version.startswith(f"Python {SUITES[root.name]}."), version
    began_s = time.monotonic()
    demo = typed(root, "./rover demo")
    print(f"{root.name}: {version.strip()}, demo {time.monotonic() - began_s:.0f} s")
    print(demo.stdout[-3000:], demo.stderr[-3000:])
    assert demo.returncode == 0
    assert re.search(r"first motion +[\d.]+ s \(installation included\)", demo.stdout)
    tests = typed(root, "./rover test -q -x tests/core/test_preview.py")
    print(tests.stdout[-500:], tests.stderr[-1500:])
    assert tests.returncode == 0
