"""Checks bills of materials in CycloneDX, and writes notices: `python -m tests.bill_of_materials`.

CONTRIBUTING.md has the commands that make them at a release.
"""

import json
import re
import sys
from collections.abc import Iterable, Iterator, Sequence
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path
from typing import Any, Final

import click
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.suite import CHECKOUT

LOCK: Final = CHECKOUT / "requirements.lock"
"""All that runs; tests and the site have locks of their own, and are not distributed."""
MANIFEST: Final = CHECKOUT / "adapters" / "console" / "static" / "vendor" / "MANIFEST.json"
REFUSED: Final = re.compile(r"\b(A?GPL|GNU (Affero )?General Public)", re.IGNORECASE)
"""Licences that would apply to what is distributed together with such a package."""
PERMITTED: Final = re.compile(r"LGPL|Lesser General|linking exception", re.IGNORECASE)

Component = dict[str, Any]


def locked(lock: Path = LOCK) -> dict[str, str]:
    """Return the versions of the packages in a lock that are for this computer."""
    lines = re.findall(r"^([a-z0-9].*?) \\$", lock.read_text(encoding="utf-8"), re.MULTILINE)
    pins = [each for each in map(Requirement, lines) if not each.marker or each.marker.evaluate()]
    return {canonicalize_name(each.name): next(iter(each.specifier)).version for each in pins}


def vendored() -> dict[str, str]:
    """Return the versions of the npm packages in the pages of the console."""
    packages: dict[str, str] = json.loads(MANIFEST.read_text(encoding="utf-8"))["packages"]
    return packages


def components(bills: Iterable[Path]) -> list[Component]:
    """Return the components of bills of materials."""
    read = (json.loads(each.read_text(encoding="utf-8")) for each in bills)
    return [component for bill in read for component in bill.get("components", ())]


def missing(found: Iterable[Component], wanted: dict[str, str]) -> list[str]:
    """Return the packages that a bill lacks, or has in another version."""
    has = {(canonicalize_name(each["name"]), each.get("version")) for each in found}
    return [f"{name} {version}" for name, version in wanted.items() if (name, version) not in has]


def licence_of(package: Distribution) -> str:
    """Return the licence that the metadata of a package names, in one line; empty if none."""
    about = package.metadata
    classifiers = about.get_all("Classifier") or ()
    named = [
        *(about.get_all("License-Expression") or ()),
        *(each.rpartition(" :: ")[2] for each in classifiers if each.startswith("License ::")),
        *(about.get_all("License") or ()),
    ]
    return next((each.strip().partition("\n")[0] for each in named if each.strip()), "")


def licences() -> Iterator[tuple[str, str]]:
    """Yield each locked package that is installed here, with its licence."""
    for name in {name for lock in CHECKOUT.glob("requirements*.lock") for name in locked(lock)}:
        try:
            yield name, licence_of(distribution(name))
        except PackageNotFoundError:
            continue


def notices(found: Sequence[Component]) -> Iterator[str]:
    """Yield the lines of the notices: name, version, licences with their texts."""
    yield "Third-party software of the rover executive, with its licences.\n"
    for each in sorted(found, key=lambda component: component["name"].lower()):
        yield f"\n{'=' * 80}\n{each['name']} {each.get('version', '')}\n"
        for entry in each.get("licenses", ()):
            licence = entry.get("license", {})
            yield entry.get("expression") or licence.get("id") or licence.get("name") or "unknown"
            yield licence.get("text", {}).get("content", "")


@click.command()
@click.argument("bills", nargs=-1, required=True, type=click.Path(exists=True, path_type=Path))
@click.option("--notices", "file", required=True, type=click.Path(path_type=Path))
def main(bills: tuple[Path, ...], file: Path) -> None:
    """Check that BILLS have all locked and vendored packages, and write their notices."""
    found = components(bills)
    if lacking := missing(found, locked() | vendored()):
        sys.exit(f"missing: {', '.join(lacking)}")
    file.write_text("\n".join(notices(found)) + "\n", encoding="utf-8")
    click.echo(f"{len(found)} components, none is missing; {file}")


if __name__ == "__main__":
    main()
