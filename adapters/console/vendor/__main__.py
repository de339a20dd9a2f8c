"""Creates the vendored files from npm: `python -m adapters.console.vendor`; `--check` compares.

CI runs the check. It also compiles the console's own modules by their JSDoc types, with the
TypeScript version of the lock file.

The packages of package-lock.json are installed from npm with their hashes. The files that pages
load, and those that only tests use (`FILES`), are stored compressed, with their licences.
MANIFEST.json has versions, and hashes of the uncompressed files, which do not depend on the
compressor.

For another version change package.json, update the lock file in this folder, then the files:

    npm install --package-lock-only --ignore-scripts --omit-lockfile-registry-resolved
"""

import argparse
import gzip
import hashlib
import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final

HERE: Final = Path(__file__).parent
CHECKOUT: Final = HERE.parents[2]
PAGES: Final = "adapters/console/static/vendor"
TESTS: Final = "tests/console/vendor"
MANIFEST: Final = "MANIFEST.json"
FILES: Final = {
    (PAGES, "openmct"): (
        "LICENSE.md",
        "dist/openmct.js",
        "dist/openmct.js.LICENSE.txt",
        "dist/inMemorySearchWorker.js",
        "dist/espressoTheme.css",
        "dist/snowTheme.css",
        "dist/fonts/Open-MCT-Symbols-12px.woff",
        "dist/fonts/Open-MCT-Symbols-16px.woff",
        "dist/images/bg-splash.jpg",
        "dist/images/logo-nasa.svg",
        "dist/images/logo-openmct-shdw.svg",
        "dist/images/logo-openmct.svg",
    ),
    (TESTS, "axe-core"): ("LICENSE", "axe.min.js"),
}
"""Vendored files by folder and package; they are stored without `dist/`."""


def fetch(scratch: Path) -> Path:
    """Install the packages of the lock file into a scratch folder, without their scripts."""
    npm = shutil.which("npm")
    if npm is None:
        raise SystemExit("npm is missing: install it (Debian: apt install npm); users need none")
    for name in ("package.json", "package-lock.json"):
        shutil.copy(HERE / name, scratch)
    command = [npm, "ci", "--ignore-scripts", "--no-audit", "--no-fund"]
    subprocess.run(command, cwd=scratch, check=True, stdout=subprocess.DEVNULL)
    return scratch / "node_modules"


def types_are_right(modules: Path) -> bool:
    """Return whether the modules conform to their JSDoc types; the compiler prints errors."""
    compiler = modules / ".bin" / "tsc"
    return subprocess.run([compiler, "-p", HERE / "jsconfig.json"], check=False).returncode == 0


def npm_files(modules: Path, folder: str) -> dict[str, bytes]:
    """Return the installed files to store in a folder, by their paths in it."""
    return {
        f"{package}/{file.removeprefix('dist/')}": (modules / package / file).read_bytes()
        for (target, package), files in FILES.items()
        for file in files
        if target == folder
    }


def manifest_of(folder: str, files: dict[str, bytes]) -> str:
    """Return the text of MANIFEST.json for the files of a folder."""
    packages = json.loads((HERE / "package-lock.json").read_text(encoding="utf-8"))["packages"]
    names = [package for target, package in FILES if target == folder]
    content = {
        "packages": {name: packages[f"node_modules/{name}"]["version"] for name in names},
        "sha256": {name: hashlib.sha256(octets).hexdigest() for name, octets in files.items()},
    }
    return json.dumps(content, indent=2) + "\n"


def write(folder: Path, files: dict[str, bytes], manifest: str) -> None:
    """Replace the vendored files of a folder."""
    shutil.rmtree(folder, ignore_errors=True)
    for name, octets in files.items():
        target = folder / f"{name}.gz"
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(gzip.compress(octets, 9, mtime=0))
    (folder / MANIFEST).write_text(manifest, encoding="utf-8")


def vendored_files(folder: Path) -> dict[str, bytes]:
    """Return the vendored files of a folder, by their paths in it."""
    return {
        path.relative_to(folder).as_posix().removesuffix(".gz"): gzip.decompress(path.read_bytes())
        for path in folder.rglob("*.gz")
    }


def main() -> None:
    """Update the vendored files, or compare them."""
    parser = argparse.ArgumentParser(description=__doc__, prog="python -m adapters.console.vendor")
    parser.add_argument("--check", action="store_true", help="compare without changes")
    check = parser.parse_args().check
    with tempfile.TemporaryDirectory() as scratch:
        modules = fetch(Path(scratch))
        for name in (PAGES, TESTS):
            folder, files = CHECKOUT / name, npm_files(modules, name)
            manifest = manifest_of(name, files)
            if not check:
                write(folder, files, manifest)
            elif (files, manifest) != (
                vendored_files(folder),
                (folder / MANIFEST).read_text(encoding="utf-8"),
            ):
                sys.exit(f"{name} differs from npm: run python -m adapters.console.vendor")
        if check and not types_are_right(modules):
            sys.exit(1)


if __name__ == "__main__":
    main()
