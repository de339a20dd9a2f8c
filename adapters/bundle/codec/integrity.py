"""`sign` and `verify` bundles: BIB-HMAC-SHA2 (RFC 9172, RFC 9173), and NASA ION's variant of it.

A block integrity block (BIB) holds an HMAC for each target. It covers the IPPT (RFC 9173, 3.7):
scope flags, the bundle parts they select, and the target. ION 4.1 builds other octets. The two
variants cannot be confused if payload or primary block are signed.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum, IntEnum, IntFlag
from typing import Final

from adapters.bundle.codec import cbor
from adapters.bundle.codec.bundle import (
    Block,
    BlockType,
    Bundle,
    Crc,
    encode_block,
    encode_primary,
    split_bundle,
)
from adapters.bundle.codec.eid import Eid, encode_eid, read_eid
from adapters.bundle.codec.errors import BundleError, DecodeError

PRIMARY_NUMBER: Final = 0
_CONTEXT: Final = 1  # security context BIB-HMAC-SHA2 (RFC 9173)
_HAS_PARAMETERS: Final = 1
_RESULT: Final = 1
_MAX_TARGETS: Final = 64  # chosen, not measured
_WRAPPED_OCTETS: Final = (24, 32, 40, 48, 56, 64, 72)
_WRAPPING_OCTETS: Final = (16, 24, 32)
_NULL_SUITE: Final = bytes(20)  # result of ION with NULL cipher suites


class IntegrityVariant(Enum):
    """Construction of the signed octets: by RFC 9173, or as NASA ION 4.1 does."""

    RFC9173 = "rfc9173"
    ION = "ion"


class Sha(IntEnum):
    """SHA variant of the HMAC, by its code (RFC 9173, 3.3.1)."""

    SHA256 = 5
    SHA384 = 6
    SHA512 = 7

    @property
    def octets(self) -> int:
        """Length of an HMAC in octets."""
        return {Sha.SHA256: 32, Sha.SHA384: 48, Sha.SHA512: 64}[self]


class _Parameter(IntEnum):
    SHA_VARIANT = 1
    WRAPPED_KEY = 2
    SCOPE_FLAGS = 3


_DEFAULT_SHA: Final = {IntegrityVariant.RFC9173: Sha.SHA384, IntegrityVariant.ION: Sha.SHA256}


class Scope(IntFlag):
    """Integrity scope flags: parts signed in addition to the target (RFC 9173, 3.3.3)."""

    PRIMARY = 1
    TARGET_HEADER = 2
    SECURITY_HEADER = 4


_WHOLE: Final = Scope.PRIMARY | Scope.TARGET_HEADER | Scope.SECURITY_HEADER


@dataclass(frozen=True, slots=True)
class Key:
    """A key shared by both ends.

    Attributes:
        octets: key of the HMAC, or the key that unwraps the session key in the block.
        form: construction of the signed octets.
        sha: variant used for signing; verification accepts all three.
    """

    octets: bytes = field(repr=False)
    form: IntegrityVariant = IntegrityVariant.RFC9173
    sha: Sha = Sha.SHA256


@dataclass(frozen=True, slots=True)
class IntegrityResult:
    """Result of the verification of one target.

    Attributes:
        target: block number.
        scope: a sum of `Scope`s.
        error: reason why the signature is invalid; empty if it is valid.
    """

    target: int
    scope: int
    error: str


@dataclass(frozen=True, slots=True)
class _Integrity:
    """Content of a BIB (RFC 9172, 3.6); None means that the default applies."""

    targets: tuple[int, ...]
    source: Eid
    results: tuple[bytes, ...]
    sha: int | None = None
    scope: int | None = None
    wrapped: bytes | None = None


def verify(
    octets: bytes, bundle: Bundle, key: Key, *, lenient: bool = False
) -> list[IntegrityResult]:
    """Verify every target of every BIB of a bundle.

    Args:
        octets: the bundle as received.
        bundle: the decoded bundle.
        key: key of its source.
        lenient: accept two outputs of ION that a receiver should not rely on: unknown variants
            as SHA-256, and targets signed without the head of their octet string.

    Raises:
        DecodeError: a BIB is malformed, or two sign the same target.
    """
    primary, *_ = split_bundle(octets)
    checks: list[IntegrityResult] = []
    for bib in bundle.blocks:
        if bib.type != BlockType.INTEGRITY:
            continue
        integrity = _decode(bib.data)
        for target, result in zip(integrity.targets, integrity.results, strict=True):
            if any(check.target == target for check in checks):
                raise DecodeError(f"block {target} is signed twice")
            scope = int(_WHOLE) if integrity.scope is None else integrity.scope
            try:
                _verify(primary, bundle, bib, integrity, target, result, key, lenient)
                fault = ""
            except _Invalid as error:
                fault = str(error)
            checks.append(IntegrityResult(target, scope, fault))
    return checks


def sign(bundle: Bundle, key: Key, source: Eid, targets: Iterable[int]) -> Bundle:
    """Return the bundle with a BIB for each target: payload, primary block, or both.

    The CRC of a signed block is removed (RFC 9173, 3.8.1). For ION the primary block keeps a 16-bit
    CRC, because ION rebuilds the block with it.

    Each fragment is signed separately, so that its receiver can verify it before it stores it.
    Otherwise unverified fragments would be stored until the bundle is complete.
    """
    import hmac  # late: it loads OpenSSL's digests, which agents without keys do not need

    signed = tuple(targets)
    crc = bundle.primary.crc
    if key.form is IntegrityVariant.ION:
        crc = Crc.CRC16
    elif PRIMARY_NUMBER in signed:
        crc = Crc.NONE
    payload = replace(bundle.blocks[-1], crc=Crc.NONE)
    bundle = Bundle(replace(bundle.primary, crc=crc), (*bundle.blocks[:-1], payload))
    primary = encode_primary(bundle.primary)
    bibs: list[Block] = []
    number = 1 + max(block.number for block in bundle.blocks)
    for target in signed:
        scope = Scope.SECURITY_HEADER if target == PRIMARY_NUMBER else _WHOLE
        bib = Block(BlockType.INTEGRITY, number + len(bibs), b"")
        ippt = _ippt(key.form, scope, primary, bundle, bib, target)
        result = hmac.digest(key.octets, ippt, key.sha.name.lower())
        integrity = _Integrity((target,), source, (result,), key.sha, scope)
        bibs.append(replace(bib, data=_encode(integrity)))
    return replace(bundle, blocks=(*bundle.blocks[:-1], *bibs, payload))


class _Invalid(Exception):  # noqa: N818 - a result of verification, not a fault
    """The signature of a target is invalid; the text gives the reason."""


def _verify(
    primary: bytes, bundle: Bundle, bib: Block, integrity: _Integrity, target: int,
    result: bytes, key: Key, lenient: bool,
) -> None:  # fmt: skip
    import hmac

    if _NULL_SUITE in (result, integrity.wrapped):
        raise _Invalid("20 zero octets: the peer uses NULL cipher suites and signs nothing")
    sha = _sha(integrity, key, lenient)
    if len(result) != sha.octets:
        raise _Invalid(f"HMAC has {len(result)} octets, {sha.name} needs {sha.octets}")
    scope = Scope(_WHOLE if integrity.scope is None else integrity.scope)
    if scope > _WHOLE:
        raise _Invalid(f"scope flags {int(scope)} exceed {int(_WHOLE)}")
    secret = key.octets if integrity.wrapped is None else _unwrapped(key, integrity.wrapped)
    ippt = _ippt(key.form, scope, primary, bundle, bib, target, lenient)
    if not hmac.compare_digest(hmac.digest(secret, ippt, sha.name.lower()), result):
        raise _Invalid("HMAC does not match")


def _sha(integrity: _Integrity, key: Key, lenient: bool) -> Sha:
    if integrity.sha is None:
        return _DEFAULT_SHA[key.form]
    try:
        return Sha(integrity.sha)
    except ValueError:
        if lenient and key.form is IntegrityVariant.ION:
            return Sha.SHA256
        raise _Invalid(f"SHA variant {integrity.sha} is not 5, 6 or 7") from None


def _unwrapped(key: Key, wrapped: bytes) -> bytes:
    """Unwrap a session key (RFC 3394)."""
    if len(key.octets) not in _WRAPPING_OCTETS or len(wrapped) not in _WRAPPED_OCTETS:
        raise _Invalid(
            f"wrapped key of {len(wrapped)} octets does not fit a key of {len(key.octets)} octets"
        )
    require_unwrapping()
    from cryptography.hazmat.primitives.keywrap import InvalidUnwrap, aes_key_unwrap

    try:
        return aes_key_unwrap(key.octets, wrapped)
    except InvalidUnwrap:
        raise _Invalid("session key cannot be unwrapped with this key") from None


def require_unwrapping() -> None:
    """Check that wrapped session keys can be unwrapped.

    Raises:
        BundleError: a package is missing; the text names it.
    """
    try:
        import cryptography  # noqa: F401
    except ImportError as error:
        raise BundleError(
            "unwrapping session keys, which NASA ION sends, needs the package cryptography: install"
            " the extra bpsec"
        ) from error


def _ippt(
    form: IntegrityVariant, scope: Scope, primary: bytes, bundle: Bundle, bib: Block, target: int,
    lenient: bool = False,
) -> bytes:  # fmt: skip
    """Return the signed octets, the IPPT (RFC 9173, 3.7); `primary` is in wire form."""
    parts = [cbor.unsigned(scope)]
    if target == PRIMARY_NUMBER:
        if form is IntegrityVariant.ION and scope & (Scope.PRIMARY | Scope.TARGET_HEADER):
            raise _Invalid(f"ION signs no primary block with scope flags {int(scope)}")
        parts += [_header(bib)] if scope & Scope.SECURITY_HEADER else []
        return b"".join([*parts, _primary_target(form, primary, bundle)])
    block = next((each for each in bundle.blocks if each.number == target), None)
    if block is None:
        raise _Invalid("target block is missing")
    parts += [primary] if scope & Scope.PRIMARY else []
    parts += [_header(block)] if scope & Scope.TARGET_HEADER else []
    parts += [_header(bib)] if scope & Scope.SECURITY_HEADER else []
    if form is IntegrityVariant.RFC9173:
        signed = cbor.octet_string(block.data)
    elif block.type == BlockType.PAYLOAD:
        signed = encode_block(replace(block, flags=0))
    elif lenient:
        signed = block.data
    else:
        raise _Invalid("ION signs extension blocks without their length, which is ambiguous")
    return b"".join([*parts, signed])


def _primary_target(form: IntegrityVariant, primary: bytes, bundle: Bundle) -> bytes:
    if form is IntegrityVariant.ION:
        return primary
    if bundle.primary.crc is not Crc.NONE:
        primary = encode_primary(replace(bundle.primary, crc=Crc.NONE))
    return cbor.octet_string(primary)


def _header(block: Block) -> bytes:
    return b"".join(map(cbor.unsigned, (block.type, block.number, block.flags)))


def _encode(integrity: _Integrity) -> bytes:
    """Encode an abstract security block (RFC 9172, 3.6), always with both parameters."""
    return b"".join(
        (
            _encode_numbers(integrity.targets),
            cbor.unsigned(_CONTEXT),
            cbor.unsigned(_HAS_PARAMETERS),
            encode_eid(integrity.source),
            cbor.array(2),
            _encode_numbers((_Parameter.SHA_VARIANT, integrity.sha or 0)),
            _encode_numbers((_Parameter.SCOPE_FLAGS, integrity.scope or 0)),
            cbor.array(len(integrity.results)),
            *(
                cbor.array(1) + cbor.array(2) + cbor.unsigned(_RESULT) + cbor.octet_string(result)
                for result in integrity.results
            ),
        )
    )


def _encode_numbers(numbers: Sequence[int]) -> bytes:
    return cbor.array(len(numbers)) + b"".join(map(cbor.unsigned, numbers))


def _decode(data: bytes) -> _Integrity:
    reader = cbor.Reader(data)
    count = reader.array()
    if not 1 <= count <= _MAX_TARGETS:
        raise reader.fail(f"BIB has {count} targets, 1 to {_MAX_TARGETS} allowed")
    targets = tuple(reader.unsigned() for _ in range(count))
    if (context := reader.unsigned()) != _CONTEXT:
        raise reader.fail(f"security context {context} is not BIB-HMAC-SHA2")
    flags = reader.unsigned()
    source = read_eid(reader)
    integrity = _Integrity(targets, source, ())
    if flags & _HAS_PARAMETERS:
        integrity = _read_parameters(reader, integrity)
    if (results := reader.array()) != count:
        raise reader.fail(f"{results} results for {count} targets")
    integrity = replace(integrity, results=tuple(_read_result(reader) for _ in range(count)))
    reader.finish()
    return integrity


def _read_parameters(reader: cbor.Reader, integrity: _Integrity) -> _Integrity:
    known: set[int] = set()
    for _ in range(reader.array()):
        reader.array_of(2)
        parameter = reader.unsigned()
        if parameter in known:
            raise reader.fail(f"duplicate security parameter {parameter}")
        known.add(parameter)
        match parameter:
            case _Parameter.SHA_VARIANT:
                integrity = replace(integrity, sha=reader.unsigned())
            case _Parameter.WRAPPED_KEY:
                integrity = replace(integrity, wrapped=reader.octet_string())
            case _Parameter.SCOPE_FLAGS:
                integrity = replace(integrity, scope=reader.unsigned())
            case _:
                raise reader.fail(f"unknown security parameter {parameter}")
    return integrity


def _read_result(reader: cbor.Reader) -> bytes:
    reader.array_of(1)
    reader.array_of(2)
    if (result := reader.unsigned()) != _RESULT:
        raise reader.fail(f"security result {result} is not an HMAC")
    return reader.octet_string()
