"""The XML: what follows from it, and values of every type and message in each encoding.

Services, types and octets one by one are held by docs/mrs.md, which is compared with the XML here.
"""

import subprocess
import sys
from pathlib import Path

from adapters.mal import Field, InteractionStage, Pattern
from adapters.mrs.spec import REQUESTS, AreaError, mrs_specification, types
from adapters.mrs.spec.specification import MRS_XML

AREA = next(area for area in mrs_specification().areas if area.name == "MRS")
HEADER = "command:CommandHeader"
OF_THE_CORE = (
    "Stage=executive.values.reports.Stage",
    "Severity=executive.values.reports.Severity",
    "NotificationKind=executive.values.reports.ReportKind",
    "PlanStatus=executive.values.reports.PlanStatus",
    "NodeStatus=executive.values.plan_nodes.NodeStatus",
    "FileEventType=executive.values.reports.FileEventKind",
    "Unmonitored=executive.faults.Unmonitored",
)
"""Types of the specification that are classes of the core: with the same numbers, or fields."""


def written(fields: tuple[Field, ...]) -> str:
    """Write fields as the tables above do."""
    names = (f"[{f.type.name}]" if f.type.is_list else f.type.name for f in fields)
    return " ".join(
        f"{f.name}:{name}{'?' if f.nullable else ''}" for f, name in zip(fields, names, strict=True)
    )


def test_has_the_number_required_by_the_standard() -> None:
    assert (AREA.name, AREA.number, AREA.version) == ("MRS", 3001, 1)
    assert [service.number for service in AREA.services] == list(range(1, 14))
    assert sum(len(service.operations) for service in AREA.services) == 79
    for service in AREA.services:
        numbers = [operation.number for operation in service.operations]
        assert numbers == list(range(1, len(numbers) + 1))


def test_has_the_errors() -> None:
    numbers = {error.name: error.number for error in AREA.errors}
    assert numbers == {
        "Invalid": 1,
        "Rejected": 2,
        "Duplicate": 3,
        "NotSupported": 4,
        "NotFound": 5,
        "Busy": 6,
    }
    assert {error.value for error in AreaError} == set(numbers.values())


def test_every_command_names_what_may_refuse_it() -> None:
    specification = mrs_specification()
    for address in REQUESTS:
        errors = specification.operation(*address).errors
        assert {"Duplicate", "Invalid", "Rejected"} <= set(errors), address


def test_commands_begin_with_the_header() -> None:
    publishes = {"registerService", "deregisterService", "sendNotification", "publishParameters"}
    publishes |= {"cancelTransfer", "fileStored"}
    for service in AREA.services:
        for operation in service.operations:
            if operation.pattern is Pattern.SUBMIT and operation.name not in publishes:
                assert written(operation.parts[InteractionStage.SUBMIT][:1]) == HEADER


def test_the_types_are_generated_from_it() -> None:
    generated = subprocess.run(
        [sys.executable, "-m", "tests.mal.generate", str(MRS_XML), *OF_THE_CORE],
        check=True,
        capture_output=True,
        text=True,
        cwd=Path(__file__).parents[2],
    ).stdout
    assert types.__file__ is not None
    assert Path(types.__file__).read_text() == generated
