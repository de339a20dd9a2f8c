"""Every captured message agrees with this stack, and the command that says so can be trusted."""

import random
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result

from tests.conformance import test_vectors
from tests.conformance.mal import mal
from tests.mal.wiretest import FILE, VECTORS_JSON


def check(*options: str) -> Result:
    return test_vectors.check(mal, VECTORS_JSON, *options)


def check_data(folder: Path, data: Any) -> Result:
    return test_vectors.check_data(mal, folder, data)


def altered(case: str, **members: Any) -> dict[str, Any]:
    """The captured file cut down to one vector, with members of it replaced."""
    (vector, *_) = (v for v in FILE["vectors"] if v["case"] == case)
    return {**FILE, "vectors": [{**vector, **members}]}


def message_of(case: str) -> bytearray:
    return bytearray.fromhex(altered(case)["vectors"][0]["message"])


def relengthened(message: bytes | bytearray) -> str:
    return (len(message).to_bytes(4, "big") + message[4:]).hex()


@pytest.mark.parametrize(
    ("arguments", "count"),
    [
        ([], 463),
        (["--encoding", "fixed"], 171),
        (["--encoding", "variable"], 146),
        (["--encoding", "split"], 146),
    ],
)
def test_all_captured_messages_agree(arguments: list[str], count: int) -> None:
    result = check(*arguments)
    assert result.output == f"{count} of {count} agree\n"
    assert result.exit_code == 0


def test_verbose_names_each_message() -> None:
    lines = check("--verbose").output.splitlines()
    assert len(lines) == 464
    assert lines[0] == "0 fixed consumer supplements.1 REQUEST: agrees"


@pytest.mark.parametrize(
    ("case", "members", "where"),
    [
        ("request.1", {"value": [2.25]}, "value[0]: 2.25 wanted, 2.5 decoded"),
        ("request.1", {"value": ["2.5"]}, "value[0]: '2.5' wanted, 2.5 decoded"),
        ("request.1", {"value": [2.5, 1]}, "value: [2.5, 1] wanted, [2.5] decoded"),
        ("request.1", {"value": None}, "value[0]: None wanted, 2.5 decoded"),
        ("request.1", {"message": "00"}, "octet 0: 23 octets expected, 1 available"),
        ("request.1", {"message": "zz"}, "message: not hex"),
        ("request.1", {"message": None}, "message: not hex"),
        ("request.1", {"encoding": "xml"}, "encoding: 'xml' is none"),
        ("request.1", {"encoding": ["fixed"]}, "encoding: \"['fixed']\" is none"),
        ("request.1", {"header": []}, "header: an object wanted"),
        ("request.1", {"header": {"area": 178}}, "header.area: 178 wanted, 177 decoded"),
        ("request.1", {"header": {"isError": 0}}, "header.isError: 0 wanted, False decoded"),
        ("request.1", {"header": {"colour": 1}}, "header.colour: no such field"),
        ("request.1", {"header": {"timestamp": "2026-11-21"}}, "is no UTC time"),
        ("request.1", {"header": {"supplements": 1}}, "header.supplements: 1 wanted"),
        ("request.1", {"headerLength": 100}, "headerLength: 100 wanted, 101 decoded"),
        ("request.1", {"body": "40"}, "body: b'@' wanted"),
        ("supplements.1", {"header": {"supplements": []}}, "header.supplements: [] wanted"),
        ("enum.2", {"value": ["IDLE", "FLY", []]}, "value[1]: 'FLY' wanted, 'DRIVE' decoded"),
        ("rec.full", {"value": [{"name": "POS_X"}, None]}, "value[0]: {'name': 'POS_X'} wanted"),
        (
            "attr.UOctet",
            {"value": [{"Octet": 3}]},
            "value[0]: {'Octet': 3} wanted, {'UOctet': 3} decoded",
        ),
        ("attr.UOctet", {"value": [3]}, "value[0]: 3 wanted, {'UOctet': 3} decoded"),
        ("error.service", {"value": [5]}, "value: [5] wanted, [70001, None] decoded"),
    ],
)
def test_what_differs_is_named_in_a_line(
    tmp_path: Path, case: str, members: dict[str, Any], where: str
) -> None:
    result = check_data(tmp_path, altered(case, **members))
    *lines, last = result.output.splitlines()
    assert where in " ".join(lines)
    assert last == "0 of 1 agree"
    assert result.exit_code == 1


def test_a_wrong_message_disagrees_and_the_others_still_count(tmp_path: Path) -> None:
    message = message_of("rec.full")
    wrong = {
        "truncated": relengthened(message[:-1]),
        "trailing": relengthened(bytes(message) + b"\0"),
        "other length": message[:-1].hex(),
        "version 0": (message[:4] + b"\x03" + message[5:]).hex(),
        "unknown operation": (message[:9] + b"\x7f\xff" + message[11:]).hex(),
        "unknown area": (message[:5] + b"\x7f\xff" + message[7:]).hex(),
    }
    vectors = [{**altered("rec.full")["vectors"][0], "message": m} for m in wrong.values()]
    result = check_data(tmp_path, {**FILE, "vectors": vectors + FILE["vectors"]})
    *lines, last = result.output.splitlines()
    assert {line.split()[0] for line in lines} == {str(i) for i in range(len(wrong))}
    assert last == "463 of 469 agree"
    assert result.exit_code == 1


def test_files_with_arbitrary_values_never_crash_it(tmp_path: Path) -> None:
    chance = random.Random(20261121)
    junk: list[Any] = [None, True, -1, 1e400, "", "\ud83d", [[]], {}, {"Long": 1}, {"a": {}}]

    def spoil(node: Any) -> Any:
        if chance.random() < 0.02:
            return chance.choice(junk)
        match node:
            case dict():
                return {k: spoil(v) for k, v in node.items() if chance.random() > 0.01}
            case list():
                return [spoil(v) for v in node if chance.random() > 0.01]
            case _:
                return node

    outcomes = set()
    for _ in range(150):
        sample = chance.sample(FILE["vectors"], 15)
        if chance.random() < 0.5:
            data = {**FILE, "vectors": spoil(sample)}
        else:
            specification = spoil(FILE["testSpecification"])
            data = {"testSpecification": specification, "vectors": sample}
        result = check_data(tmp_path, data)
        assert result.exception is None or isinstance(result.exception, SystemExit)
        outcomes.add(result.exit_code)
    assert outcomes >= {1, 2}
    assert outcomes <= {0, 1, 2}
