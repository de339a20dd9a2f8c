"""Certificates made for a test: of a rover, its ground, and of those that neither believes."""

from dataclasses import dataclass
from pathlib import Path

import trustme

from adapters.mal import Certificates


@dataclass(frozen=True, slots=True)
class Ends:
    """Who is there.

    Attributes:
        stranger: believes the rover's authority, and is vouched for by another.
        suspicious: is vouched for by the rover's authority, and believes another.
    """

    rover: Certificates
    ground: Certificates
    stranger: Certificates
    suspicious: Certificates


def make_ends(folder: Path) -> Ends:
    """Certify all of them for 127.0.0.1."""
    ours, theirs = trustme.CA(), trustme.CA()
    return Ends(
        _certified(folder, "rover", ours, ours),
        _certified(folder, "ground", ours, ours),
        _certified(folder, "stranger", theirs, ours),
        _certified(folder, "suspicious", ours, theirs),
    )


def certified(folder: Path, *names: str) -> dict[str, Certificates]:
    """Certify each by its name for 127.0.0.1, all by one authority that all believe."""
    ours = trustme.CA()
    return {name: _certified(folder, name, ours, ours, common_name=name) for name in names}


def authority_for(folder: Path, *names: str) -> None:
    """Make the files `authority.pem`, and `NAME.pem` and `NAME.key` of each name."""
    authority = trustme.CA()
    for name in names:
        _certified(folder, name, authority, authority).authorities.replace(folder / "authority.pem")


def options(certificates: Certificates) -> list[str]:
    """Return certificates as they are typed."""
    return [
        *("--certificate", str(certificates.certificate)),
        *("--key", str(certificates.key)),
        *("--authorities", str(certificates.authorities)),
    ]


def _certified(
    folder: Path,
    name: str,
    by: trustme.CA,
    believes: trustme.CA,
    common_name: str | None = None,
) -> Certificates:
    certificate, key, authorities = (folder / f"{name}.{part}" for part in ("pem", "key", "ca"))
    made = by.issue_cert("127.0.0.1", common_name=common_name)
    made.cert_chain_pems[0].write_to_path(str(certificate))
    made.private_key_pem.write_to_path(str(key))
    believes.cert_pem.write_to_path(str(authorities))
    return Certificates(certificate, key, authorities)
