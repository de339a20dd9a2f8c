"""What the pages take from npm is in the checkout, whole, and says what it is."""

import gzip
import hashlib
import json

from tests.docs.pages import CHECKOUT

CONSOLE = CHECKOUT / "adapters" / "console"
RETAINED = CONSOLE / "static" / "vendor"


def test_npm_packages_match_their_manifest_and_the_lock() -> None:
    manifest = json.loads((RETAINED / "MANIFEST.json").read_text(encoding="utf-8"))
    lock = json.loads((CONSOLE / "vendor" / "package-lock.json").read_text(encoding="utf-8"))
    stored = {
        path.relative_to(RETAINED).as_posix().removesuffix(".gz"): hashlib.sha256(
            gzip.decompress(path.read_bytes())
        ).hexdigest()
        for path in RETAINED.rglob("*.gz")
    }
    assert manifest["sha256"] == stored
    assert manifest["packages"] == {
        name.removeprefix("node_modules/"): package["version"]
        for name, package in lock["packages"].items()
        if name and not package.get("dev", False)
    }


def test_its_licences_are_beside_it() -> None:
    licence = gzip.decompress((RETAINED / "openmct" / "LICENSE.md.gz").read_bytes()).decode()
    assert "Apache License, Version 2.0" in licence
    assert (RETAINED / "openmct" / "openmct.js.LICENSE.txt.gz").is_file()
