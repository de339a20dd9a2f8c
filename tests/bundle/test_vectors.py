"""`rover bundle check`: everything recorded agrees, and what is changed is found."""

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from adapters.bundle.commands import bundle

VECTORS = Path(__file__).with_name("vectors.json")


def check(path: Path, *options: str) -> Result:
    return CliRunner().invoke(bundle, ["check", str(path), *options])


@pytest.fixture
def data() -> Any:
    return json.loads(VECTORS.read_text())


def written(folder: Path, data: object) -> Path:
    path = folder / "changed.json"
    path.write_text(json.dumps(data))
    return path


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
    result = check(written(tmp_path, data))
    assert result.exit_code == 1
    assert result.output.startswith("bundle 0 ")
    assert result.output.endswith("30 of 31 agree\n")


@pytest.mark.parametrize("section", ["vectors", "ltp_segments", "tcpclv3_stream"])
def test_octets_that_differ_are_found(tmp_path: Path, data: Any, section: str) -> None:
    octets = data[section][0]["hex"]
    data[section][0]["hex"] = "7f" + octets[2:]
    result = check(written(tmp_path, data))
    assert result.exit_code == 1
    assert "does not decode" in result.output


def test_a_wrong_status_report_is_found(tmp_path: Path, data: Any) -> None:
    data["vectors"][-1]["fields"]["admin"][1][1] = 9
    assert "admin is" in check(written(tmp_path, data)).output


def test_another_segment_than_was_said_is_found(tmp_path: Path, data: Any) -> None:
    data["ltp_segments"][0]["type"] = "report segment"
    assert check(written(tmp_path, data)).exit_code == 1


@pytest.mark.parametrize(
    "content",
    [
        "{", "[]", "{}", '{"vectors": 1}', '{"vectors": [1]}', '{"vectors": [{"hex": "0"}]}',
        '{"vectors": [{"hex": "", "fields": []}]}', "[" * 100_000,
        '{"vectors": [{"hex": "", "fields": {"blocks": [1]}}]}',
    ],
)  # fmt: skip
def test_what_is_no_vector_file_is_refused_in_one_line(tmp_path: Path, content: str) -> None:
    path = tmp_path / "bad.json"
    path.write_text(content)
    result = check(path)
    assert result.exit_code == 2
    assert len(result.output.splitlines()) == 1


def test_nothing_to_check_is_no_success(tmp_path: Path) -> None:
    assert check(written(tmp_path, {"vectors": []})).exit_code == 1
    assert check(tmp_path / "missing.json").exit_code == 2
