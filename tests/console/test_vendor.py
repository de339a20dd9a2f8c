"""What the pages take from npm is in the checkout, whole, and says what it is."""

import gzip
import hashlib
import json

from tests.docs.pages import CHECKOUT

CONSOLE = CHECKOUT / "adapters" / "console"
KEPT = CONSOLE / "static" / "vendor"


def test_what_comes_from_npm_is_what_its_manifest_and_the_lock_say() -> None:
    manifest = json.loads((KEPT / "MANIFEST.json").read_text(encoding="utf-8"))
    lock = json.loads((CONSOLE / "vendor" / "package-lock.json").read_text(encoding="utf-8"))
    kept = {
        path.relative_to(KEPT).as_posix().removesuffix(".gz"): hashlib.sha256(
            gzip.decompress(path.read_bytes())
        ).hexdigest()
        for path in KEPT.rglob("*.gz")
    }
    assert manifest["sha256"] == kept
    assert manifest["packages"] == {
        name.removeprefix("node_modules/"): package["version"]
        for name, package in lock["packages"].items()
        if name and not package.get("dev", False)
    }


def test_its_licences_are_beside_it() -> None:
    licence = gzip.decompress((KEPT / "openmct" / "LICENSE.md.gz").read_bytes()).decode()
    assert "Apache License, Version 2.0" in licence
    assert (KEPT / "openmct" / "openmct.js.LICENSE.txt.gz").is_file()
