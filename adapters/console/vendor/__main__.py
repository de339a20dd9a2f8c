"""Makes `static/vendor` from npm: `python -m adapters.console.vendor`; `--check` only compares.

The check, which CI runs, also compiles our own modules by the types of their comments (JSDoc), with
the TypeScript of the lock.

It asks npm for what package-lock.json names, by its hashes, and keeps of that what the pages load
(`FILES`), compressed, with its licences. MANIFEST.json has versions, and hashes of what is inside
the .gz: those do not depend on who compressed it.

For another version change package.json, in this folder make the lock, then `static/vendor`:

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
KEPT: Final = HERE.parent / "static" / "vendor"
MANIFEST: Final = "MANIFEST.json"
FILES: Final = {
    "openmct": (
        "LICENSE.md",
        "dist/openmct.js",
        "dist/openmct.js.LICENSE.txt",
        "dist/inMemorySearchWorker.js",
        "dist/espressoTheme.css",
        "dist/fonts/Open-MCT-Symbols-12px.woff",
        "dist/fonts/Open-MCT-Symbols-16px.woff",
        "dist/images/bg-splash.jpg",
        "dist/images/logo-nasa.svg",
        "dist/images/logo-openmct-shdw.svg",
        "dist/images/logo-openmct.svg",
    )
}
"""By package; they are served without `dist/`."""


def fetch(scratch: Path) -> Path:
    """Install what the lock names into a scratch folder, running no script of any package."""
    npm = shutil.which("npm")
    if npm is None:
        raise SystemExit("npm is missing: install it (Debian: apt install npm); users need none")
    for name in ("package.json", "package-lock.json"):
        shutil.copy(HERE / name, scratch)
    command = [npm, "ci", "--ignore-scripts", "--no-audit", "--no-fund"]
    subprocess.run(command, cwd=scratch, check=True, stdout=subprocess.DEVNULL)
    return scratch / "node_modules"


def types_are_right(modules: Path) -> bool:
    """Return whether our modules are what their comments say; the compiler tells what is not."""
    compiler = modules / ".bin" / "tsc"
    return subprocess.run([compiler, "-p", HERE / "jsconfig.json"], check=False).returncode == 0


def chosen(modules: Path) -> dict[str, bytes]:
    """Return the files that are kept, by where they are served."""
    return {
        f"{package}/{file.removeprefix('dist/')}": (modules / package / file).read_bytes()
        for package, files in FILES.items()
        for file in files
    }


def manifest_of(files: dict[str, bytes]) -> str:
    """Return MANIFEST.json for some files."""
    packages = json.loads((HERE / "package-lock.json").read_text(encoding="utf-8"))["packages"]
    content = {
        "packages": {name: packages[f"node_modules/{name}"]["version"] for name in FILES},
        "sha256": {name: hashlib.sha256(octets).hexdigest() for name, octets in files.items()},
    }
    return json.dumps(content, indent=2) + "\n"


def write(files: dict[str, bytes]) -> None:
    """Replace what is kept."""
    shutil.rmtree(KEPT, ignore_errors=True)
    for name, octets in files.items():
        target = KEPT / f"{name}.gz"
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(gzip.compress(octets, 9, mtime=0))
    (KEPT / MANIFEST).write_text(manifest_of(files), encoding="utf-8")


def kept() -> dict[str, bytes]:
    """Return what is kept, by where it is served."""
    return {
        path.relative_to(KEPT).as_posix().removesuffix(".gz"): gzip.decompress(path.read_bytes())
        for path in KEPT.rglob("*.gz")
    }


def main() -> None:
    """Make it anew, or compare."""
    parser = argparse.ArgumentParser(description=__doc__, prog="python -m adapters.console.vendor")
    parser.add_argument("--check", action="store_true", help="compare, and change nothing")
    check = parser.parse_args().check
    with tempfile.TemporaryDirectory() as scratch:
        modules = fetch(Path(scratch))
        files = chosen(modules)
        if not check:
            write(files)
        elif files != kept() or manifest_of(files) != (KEPT / MANIFEST).read_text(encoding="utf-8"):
            sys.exit(f"{KEPT} is not what npm gives: run python -m adapters.console.vendor")
        elif not types_are_right(modules):
            sys.exit(1)


if __name__ == "__main__":
    main()
