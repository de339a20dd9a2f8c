"""`Security`: signs and verifies bundles by policies and keys of the section `security`."""

import logging
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from functools import lru_cache
from pathlib import Path
from typing import Final

from adapters.bundle.codec.bundle import PAYLOAD_NUMBER, Bundle, Primary
from adapters.bundle.codec.eid import Eid, encode_eid
from adapters.bundle.codec.errors import BundleError
from adapters.bundle.codec.integrity import (
    PRIMARY_NUMBER,
    IntegrityVariant,
    Key,
    Scope,
    Sha,
    require_unwrapping,
    sign,
    verify,
)
from adapters.system import OPERATING_SYSTEM

_LOG: Final = logging.getLogger(__name__)
KEY_OCTETS: Final = 32
"""Length of a generated key."""
_MIN_KEY_OCTETS: Final = 16
_MAX_KEY_OCTETS: Final = 1024
_ION_OCTETS: Final = (16, 24, 32)
_BLOCK_OCTETS: Final = 110
"""Octets of a BIB with one target, without the EID in it."""


class SignedBlock(Enum):
    """Block that a policy requires to be signed."""

    PAYLOAD = "payload"
    PRIMARY = "primary"


_NUMBERS: Final = {SignedBlock.PAYLOAD: PAYLOAD_NUMBER, SignedBlock.PRIMARY: PRIMARY_NUMBER}


@dataclass(frozen=True, slots=True, kw_only=True)
class KeySettings:
    """A key shared by both ends.

    Attributes:
        file: file with the raw key, 16 octets or more; relative to the settings file.
        form: construction of the signed octets; ion for NASA ION 4.1, which accepts only its own.
        sha: 256, 384 or 512.
    """

    file: str
    form: IntegrityVariant = IntegrityVariant.RFC9173
    sha: int = 256

    def __post_init__(self) -> None:
        if self.sha not in (256, 384, 512):
            raise ValueError(f"sha is {self.sha}, must be 256, 384 or 512")


@dataclass(frozen=True, slots=True, kw_only=True)
class PolicySettings:
    """A signature policy.

    Attributes:
        key: name of the key.
        source, destination: EID patterns of the bundles it applies to; `*` matches any characters.
        targets: blocks that must be signed.
        covers_primary: whether a signed payload must cover the primary block. Without it anyone
            can resend the payload in another bundle.
    """

    key: str
    source: str = "*"
    destination: str = "*"
    targets: tuple[SignedBlock, ...] = (SignedBlock.PAYLOAD,)
    covers_primary: bool = True

    def __post_init__(self) -> None:
        if not self.targets or len(set(self.targets)) != len(self.targets):
            raise ValueError("targets must be payload, primary, or both")

    @property
    def numbers(self) -> tuple[int, ...]:
        """Block numbers of the targets."""
        return tuple(_NUMBERS[target] for target in self.targets)


@dataclass(frozen=True, slots=True, kw_only=True)
class SecuritySettings:
    """The section `security` of a settings file.

    Attributes:
        policies: the first match applies. Bundles without a matching policy are sent unsigned,
            and are rejected if they are addressed to this node.
    """

    keys: Mapping[str, KeySettings]
    policies: tuple[PolicySettings, ...]

    def __post_init__(self) -> None:
        for policy in self.policies:
            if policy.key not in self.keys:
                known = ", ".join(self.keys) or "none"
                raise ValueError(f"security.policies names the key {policy.key}; keys has {known}")


class Security:
    """Signs outgoing and verifies received bundles, with keys by name."""

    def __init__(self, node: Eid, settings: SecuritySettings, keys: Mapping[str, Key]) -> None:
        self._node, self._policies, self._keys = node, settings.policies, keys

    def signature_error(self, bundle: Bundle, octets: bytes, *, local: bool) -> str:
        """Return why a signature is invalid or missing; empty if it is valid or not required.

        Bundles to this node (`local`) must be signed. `octets` is the bundle as received.
        """
        policy = self._policy(bundle.primary)
        if policy is None:
            return "no signature policy matches it" if local else ""
        try:
            checks = verify(octets, bundle, self._keys[policy.key])
        except BundleError as error:
            return f"signature: {error}"
        scopes = {check.target: check.scope for check in checks}
        for check in checks:
            if check.error:
                return f"{_name(check.target)}: {check.error}"
        for target in policy.numbers:
            if target not in scopes:
                return f"{_name(target)} is not signed"
        free = not scopes.get(PAYLOAD_NUMBER, Scope.PRIMARY) & Scope.PRIMARY
        if policy.covers_primary and free:  # even where both are signed, one by one
            return f"signature does not cover the primary block: scope {scopes[PAYLOAD_NUMBER]}"
        return ""

    def octets(self, primary: Primary) -> int:
        """Return the maximum number of octets that signing adds to a bundle."""
        policy = self._policy(primary)
        each = _BLOCK_OCTETS + len(encode_eid(self._node))
        return each * len(policy.targets) if policy else 0

    def sign(self, bundle: Bundle) -> Bundle:
        """Return an own bundle with the signatures that its policy requires."""
        policy = self._policy(bundle.primary)
        if policy is None:
            return bundle
        return sign(bundle, self._keys[policy.key], self._node, policy.numbers)

    def _policy(self, primary: Primary) -> PolicySettings | None:
        source, destination = str(primary.source), str(primary.destination)
        return next(
            (
                policy
                for policy in self._policies
                if _pattern(policy.source).fullmatch(source)
                and _pattern(policy.destination).fullmatch(destination)
            ),
            None,
        )


def load_security(
    settings_file: Path, settings: SecuritySettings | None, node: Eid
) -> Security | None:
    """Return a node's `Security` with its keys loaded; None without a section `security`.

    Paths of keys are relative to the settings file.

    Raises:
        BundleError: a key cannot be read or used; the text names it and the remedy.
    """
    if settings is None:
        return None
    folder = settings_file.parent
    keys = {name: _load(folder / key.file, key) for name, key in settings.keys.items()}
    return Security(node, settings, keys)


def make_key(path: Path) -> None:
    """Write a key of random octets to a new file that only its owner may read.

    Raises:
        OSError: the file exists or cannot be written.
    """
    with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as made:
        made.write(OPERATING_SYSTEM.random_octets(KEY_OCTETS))


def _load(path: Path, settings: KeySettings) -> Key:
    try:
        octets = path.read_bytes()
        mode = path.stat().st_mode
    except OSError as error:
        raise BundleError(
            f"key {path}: {error.strerror}; `rover bundle key {path}` makes one, for both ends"
        ) from error
    fits = _MIN_KEY_OCTETS <= len(octets) <= _MAX_KEY_OCTETS
    if settings.form is IntegrityVariant.ION:
        require_unwrapping()
        fits = len(octets) in _ION_OCTETS
    if not fits:
        wanted = (
            "16, 24 or 32"
            if settings.form is IntegrityVariant.ION
            else f"{_MIN_KEY_OCTETS} or more"
        )
        raise BundleError(f"key {path} has {len(octets)} octets: {wanted}, without a line's end")
    if mode & 0o077:
        _LOG.warning("key %s can be read by others: chmod 600 %s", path, path)
    return Key(octets, settings.form, Sha[f"SHA{settings.sha}"])


@lru_cache
def _pattern(text: str) -> re.Pattern[str]:
    return re.compile(".*".join(map(re.escape, text.split("*"))))


def _name(target: int) -> str:
    names = {PRIMARY_NUMBER: "the primary block", PAYLOAD_NUMBER: "the payload"}
    return names.get(target, f"block {target}")
