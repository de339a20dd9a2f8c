"""The fuzzing of a node, as `rover bench bundle-fuzz` does it, and that it can fail."""

import logging
from collections.abc import Iterator
from dataclasses import replace

import pytest

from adapters.bundle.codec.bundle import Bundle, decode_bundle
from tests.stress import bundle_fuzz


@pytest.fixture(autouse=True)
def _log_as_before() -> Iterator[None]:
    logger = logging.getLogger("adapters.bundle")
    level = logger.level
    yield
    logger.setLevel(level)


def test_invalid_input_is_refused_and_nothing_grows() -> None:
    figures = bundle_fuzz.measure(6000, 2, print)
    assert [figure.name for figure in figures if figure.met is False] == []
    values = {figure.name: figure.value for figure in figures}
    assert values["bundles: refused"] > 3000
    assert values["bundles: sound all the same"] > 50


def test_other_errors_and_other_octets_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    def crash(octets: bytes) -> None:
        raise KeyError(octets)

    def misread(octets: bytes) -> Bundle:
        bundle = decode_bundle(octets)
        primary = replace(bundle.primary, lifetime_ms=bundle.primary.lifetime_ms ^ 1)
        return replace(bundle, primary=primary)

    monkeypatch.setattr(bundle_fuzz, "decode_segment", crash)
    monkeypatch.setattr(bundle_fuzz, "decode_bundle", misread)
    raised, changed = bundle_fuzz.measure(300, 3, lambda _: None)[:2]
    assert (raised.value, raised.met) == (100, False)
    assert changed.value > 10
    assert not changed.met
