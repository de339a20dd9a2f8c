"""The command `rover docs`: builds the documentation site of this checkout.

Sphinx reads the Markdown and refuses broken links and anchors. The pages are then read as a
browser would: each link has its file and its anchor in the site, and nothing is loaded from the
network.
"""

import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final
from urllib.parse import unquote, urlsplit

import click

CHECKOUT: Final = Path(__file__).resolve().parents[2]
SITE: Final = CHECKOUT / "docs" / "site"
LOCK: Final = CHECKOUT / "requirements-docs.lock"
PACKAGES: Final = CHECKOUT / ".venv-docs"
"""Where the packages of the lock lie: beside the environment of the rover, not in it."""
ENTRANCE: Final = "README.html"
_REDIRECT: Final = (
    '<!doctype html><html lang="en"><meta charset="utf-8"><title>Rover executive</title>'
    '<meta http-equiv="refresh" content="0; url={0}"><a href="{0}">Documentation</a></html>\n'
)
_LOADED: Final = {("link", "href"), ("script", "src"), ("img", "src"), ("source", "srcset")}


@click.command()
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=CHECKOUT / "runs" / "site",
    help="The folder with a folder for each version (runs/site).",
)
def docs(out: Path) -> None:
    """Build the documentation as a site that needs no network.

    It has a search, a light and a dark theme, the reference of the Python API, and a list of the
    versions in its folder: to add an older one, build its checkout into the same folder. A broken
    link or anchor is an error. The first call installs the packages of requirements-docs.lock.

    \b
    Examples:
      rover docs
      rover docs --out public
    """
    began_s = time.monotonic()
    install()
    site = build(out)
    if broken := list(broken_links(site)):
        raise click.ClickException("\n".join(["the site is broken:", *broken]))
    pages = sum(1 for _ in site.rglob("*.html"))
    click.echo(f"{pages} pages in {time.monotonic() - began_s:.0f} s: {site / ENTRANCE}")


def install() -> None:
    """Install the packages of the lock, if they are not those that are there."""
    stamp, wanted = PACKAGES / "stamp", f"{sys.version}\n{LOCK.read_text(encoding='utf-8')}"
    if stamp.is_file() and stamp.read_text(encoding="utf-8") == wanted:
        return
    shutil.rmtree(PACKAGES, ignore_errors=True)
    locked = ("--no-deps", "--only-binary", ":all:", "--require-hashes", "-r", str(LOCK))
    quiet = ("-qq", "--disable-pip-version-check")
    click.echo(f"first use: downloading the tool into {PACKAGES.name} (a minute or two)", err=True)
    command = (sys.executable, "-m", "pip", "install", *quiet, "--target", str(PACKAGES), *locked)
    if subprocess.run(command, check=False).returncode:
        raise click.ClickException(
            "pip could not install requirements-docs.lock. It needs the Python package index"
            " within reach, this once; start again."
        )
    (PACKAGES / "COLCON_IGNORE").touch()
    stamp.write_text(wanted, encoding="utf-8")


def build(out: Path, source: Path = CHECKOUT) -> Path:
    """Build the pages of a checkout into the folder of its version, and return that.

    Raises:
        ClickException: Sphinx found an error, a broken link or anchor for instance.
    """
    name = re.search(r'^version = "(.+)"', (CHECKOUT / "pyproject.toml").read_text(), re.MULTILINE)
    assert name is not None
    site = out.absolute() / name[1]
    if site.exists() and not (site / ".buildinfo").is_file():
        raise click.ClickException(f"{site} is no site of an earlier build: choose another --out")
    fresh = site.with_name(f".{site.name}")
    shutil.rmtree(fresh, ignore_errors=True)
    known = {**os.environ, "PYTHONPATH": f"{PACKAGES}{os.pathsep}{CHECKOUT}"}
    with TemporaryDirectory() as scratch:
        strictly = ("-W", "--keep-going", "-q", "-j", "auto", "-d", scratch)
        folders = ("-c", str(SITE), str(source), str(fresh))
        command = (sys.executable, "-m", "sphinx", *strictly, *folders)
        if subprocess.run(command, env=known, check=False).returncode:
            raise click.ClickException("the pages have the errors above")
    shutil.rmtree(site, ignore_errors=True)
    fresh.rename(site)
    versions = [each.parent.name for each in out.glob("[!.]*/.buildinfo")]
    versions.sort(key=lambda each: [int(part) for part in re.findall(r"\d+", each)], reverse=True)
    (out / "versions.js").write_text(f"window.VERSIONS = {versions};\n", encoding="utf-8")
    (out / "index.html").write_text(_REDIRECT.format(f"{versions[0]}/{ENTRANCE}"), encoding="utf-8")
    (site / "index.html").write_text(_REDIRECT.format(ENTRANCE), encoding="utf-8")
    return site


class _Page(HTMLParser):
    """Anchors and targets of a page, the latter with whether the browser loads them by itself."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.targets: list[tuple[str, bool]] = []
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name in ("id", "name") and value:
                self.anchors.add(value)
            elif name in ("href", "src", "srcset") and value is not None:
                self.targets.append((value, (tag, name) in _LOADED))


def broken_links(site: Path) -> Iterator[str]:
    """Yield each link without its file or anchor, and each file loaded from the network."""
    pages = {path: _Page(path) for path in sorted(site.rglob("*.html"))}
    for path, page in pages.items():
        for target, loaded in page.targets:
            url = urlsplit(target)
            linked = (path.parent / unquote(url.path)).resolve() if url.path else path
            where = f"{path.relative_to(site)}: {target}"
            if url.scheme or url.netloc:
                if loaded and url.scheme != "data":
                    yield f"{where} is loaded from the network"
            elif not linked.exists():
                yield f"{where} does not exist"
            elif url.fragment and unquote(url.fragment) not in pages[linked].anchors:
                yield f"{where} has no such anchor"
    for style in sorted(site.rglob("*.css")):
        text = style.read_text(encoding="utf-8")
        for target in re.findall(r"""(?:url\(|@import)\s*["']?(https?:[^"')]+)""", text):
            yield f"{style.relative_to(site)}: {target} is loaded from the network"
