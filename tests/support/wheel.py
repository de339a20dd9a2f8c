"""The sdist of a copy of the checkout, and the wheel that is built from it."""

import shutil
import subprocess
import sys
from pathlib import Path
from typing import Final

CHECKOUT: Final = Path(__file__).resolve().parents[2]
PACKAGES: Final = ("executive", "trees", "adapters", "sim")
FRAME: Final = ("pyproject.toml", "setup.py", "setup.cfg", "package.xml", "resource", "config",
                "docs", "launch", "README.md", "LICENSE", "rover_executive.py")  # fmt: skip
"""What a wheel is made of, besides the packages."""


def build_wheel(folder: Path) -> Path:
    """Return a wheel, built from an sdist, below a folder; the sdist is in `copy/dist` in it."""
    copy = folder / "copy"
    copy.mkdir()
    leave = shutil.ignore_patterns("__pycache__")
    for name in (*FRAME, *PACKAGES):
        if (CHECKOUT / name).is_dir():
            shutil.copytree(CHECKOUT / name, copy / name, ignore=leave)
        else:
            shutil.copy(CHECKOUT / name, copy)
    sdist = _build(copy, "sdist")
    unpacked = folder / "unpacked"
    unpacked.mkdir()
    subprocess.run(("tar", "-xf", sdist, "-C", unpacked), check=True)
    (source,) = unpacked.iterdir()
    return _build(source, "wheel")


def _build(folder: Path, kind: str) -> Path:
    """Build an sdist or a wheel of a folder as pip does; return it."""
    code = f"from setuptools import build_meta; print(build_meta.build_{kind}('dist'))"
    subprocess.run([sys.executable, "-c", code], cwd=folder, check=True, capture_output=True)
    (built,) = (folder / "dist").iterdir()
    return built
