"""`rover bundle check`: everything recorded agrees, and what is changed is found."""

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result

from tests.conformance import test_vectors
from tests.conformance.bundle import bundle

FOLDER = Path(__file__).parents[1] / "bundle"
VECTORS, SIGNED = FOLDER / "vectors.json", FOLDER / "bpsec-vectors.json"


def check(path: Path, *options: str) -> Result:
    return test_vectors.check(bundle, path, *options)


def check_data(folder: Path, data: Any) -> Result:
    return test_vectors.check_data(bundle, folder, data)


@pytest.fixture
def data() -> Any:
    return json.loads(VECTORS.read_text())


def test_everything_that_was_recorded_agrees() -> None:
    result = check(VECTORS)
    assert (result.exit_code, result.output) == (0, "31 of 31 agree\n")


def test_verbose_names_what_agrees() -> None:
    assert "bundle 0 pyd3tn->ION udpcl: agrees\n" in check(VECTORS, "--verbose").output


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("flags", 5),
        ("crc", 1),
        ("crc_ok", None),
        ("destination", "ipn:1.2"),
        ("creation", [848564093211, 1]),
        ("lifetime_ms", 1),
        ("payload_hex", "00"),
        ("payload_text", "other"),
        ("fragment_offset", 0),
        ("blocks", []),
        ("blocks", [{"type": 1, "number": 2}]),
        ("unheard_of", 1),
    ],
)
def test_a_field_that_differs_is_found(tmp_path: Path, data: Any, field: str, value: Any) -> None:
    data["vectors"][0]["fields"][field] = value
    result = check_data(tmp_path, data)
    assert result.exit_code == 1
    assert result.output.startswith("bundle 0 ")
    assert result.output.endswith("30 of 31 agree\n")


@pytest.mark.parametrize(
    ("section", "fault"),
    [
        ("vectors", "octet 1: expected array of indefinite length"),
        ("ltp_segments", "LTP version 7"),
        ("tcpclv3_stream", "TCPCL message of undefined type 7"),
    ],
)
def test_octets_that_differ_are_found(tmp_path: Path, data: Any, section: str, fault: str) -> None:
    octets = data[section][0]["hex"]
    data[section][0]["hex"] = "7f" + octets[2:]
    result = check_data(tmp_path, data)
    assert result.exit_code == 1
    assert fault in result.output


def test_a_wrong_status_report_is_found(tmp_path: Path, data: Any) -> None:
    data["vectors"][-1]["fields"]["admin"][1][1] = 9
    assert "admin[1][1]: 9 wanted" in check_data(tmp_path, data).output


def test_a_deviating_segment_is_found(tmp_path: Path, data: Any) -> None:
    data["ltp_segments"][0]["type"] = "report segment"
    assert check_data(tmp_path, data).exit_code == 1


def test_every_signature_gets_its_verdict_and_a_line() -> None:
    result = check(SIGNED)
    lines = result.output.splitlines()
    assert result.exit_code == 0
    assert lines[-1] == "44 of 44 agree"
    assert "signature 13 ION, no rule matches: unsigned: unsigned: no BIB" in lines
    assert "signature 23 python signs: wrong key: invalid: block 1: HMAC does not match" in lines


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"expected_verdict": "valid", "key_hex": "00" * 32}, "invalid (block 1: session key"),
        ({"expected_verdict": "invalid"}, "valid (block 1 with scope 7, form ion), invalid wanted"),
        ({"ippt_form": "rfc9173"}, "invalid (block 1: HMAC does not match), valid wanted"),
        ({"required_targets": [0, 1]}, "invalid (block 0 is not signed, and has to be), valid"),
        ({"hex": "9f00"}, "invalid (octet "),
        ({"unheard_of": 1, "fields": None}, "1 of 1 agree"),
    ],
)
def test_a_wrong_verdict_is_found(tmp_path: Path, change: Any, why: str) -> None:
    row = json.loads(SIGNED.read_text())["vectors"][0]
    result = check_data(tmp_path, {"vectors": [row | change]})
    assert why in result.output
    assert result.exit_code == (0 if "1 of 1" in why else 1)
