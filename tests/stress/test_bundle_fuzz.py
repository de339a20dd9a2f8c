"""The fuzzing of a node, as `rover bench bundle-fuzz` does it, and that it can fail."""

import logging
from collections.abc import Iterator

import pytest

from tests.stress import bundle_fuzz


@pytest.fixture(autouse=True)
def _log_as_before() -> Iterator[None]:
    logger = logging.getLogger("adapters.bundle")
    level = logger.level
    yield
    logger.setLevel(level)


def test_what_is_wrong_is_refused_and_nothing_grows() -> None:
    figures = bundle_fuzz.measure(6000, 2)
    assert [figure.name for figure in figures if figure.met is False] == []
    values = {figure.name: figure.value for figure in figures}
    assert values["fuzz: refused"] > 3000
    assert values["fuzz: sound all the same"] > 50


def test_another_error_than_that_of_decoding_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    def crash(octets: bytes) -> None:
        raise KeyError(octets)

    monkeypatch.setattr(bundle_fuzz, "decode_segment", crash)
    faults = bundle_fuzz.measure(300, 3)[0]
    assert (faults.value, faults.met) == (100, False)
