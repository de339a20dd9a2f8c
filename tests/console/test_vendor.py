"""What the pages and their tests take from npm is in the checkout, whole, and says what it is."""

import gzip
import hashlib
import json
from pathlib import Path

import pytest

from tests.docs.pages import CHECKOUT

CONSOLE = CHECKOUT / "adapters" / "console"
FOLDERS = {
    CONSOLE / "static" / "vendor": {"openmct"},
    CHECKOUT / "tests" / "console" / "vendor": {"axe-core"},
}


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.parent.name)
def test_npm_packages_match_their_manifest_and_the_lock(folder: Path) -> None:
    manifest = json.loads((folder / "MANIFEST.json").read_text(encoding="utf-8"))
    lock = json.loads((CONSOLE / "vendor" / "package-lock.json").read_text(encoding="utf-8"))
    stored = {
        path.relative_to(folder).as_posix().removesuffix(".gz"): hashlib.sha256(
            gzip.decompress(path.read_bytes())
        ).hexdigest()
        for path in folder.rglob("*.gz")
    }
    assert manifest["sha256"] == stored
    assert manifest["packages"] == {
        name: lock["packages"][f"node_modules/{name}"]["version"] for name in FOLDERS[folder]
    }


@pytest.mark.parametrize(
    ("path", "licence"),
    [
        ("adapters/console/static/vendor/openmct/LICENSE.md.gz", "Apache License, Version 2.0"),
        ("tests/console/vendor/axe-core/LICENSE.gz", "Mozilla Public License, version 2.0"),
    ],
)
def test_its_licences_are_beside_it(path: str, licence: str) -> None:
    assert licence in gzip.decompress((CHECKOUT / path).read_bytes()).decode()
