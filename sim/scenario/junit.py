"""JUnit XML, as continuous integration reads it: suites of cases that passed, failed or broke."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum, unique
from typing import BinaryIO
from xml.etree import ElementTree

from executive.values.reports import printable


@unique
class CaseStatus(Enum):
    """What is wrong with a case, by the name of its element."""

    FAILURE = "failure"
    """It was looked at, and does not hold."""
    ERROR = "error"
    """It could not be looked at."""
    SKIPPED = "skipped"
    """It does not hold, and need not."""


@dataclass(frozen=True, slots=True)
class JunitCase:
    """One thing that was to hold.

    Attributes:
        seen: what was found.
        trouble: None where it holds.
    """

    name: str
    seen: str
    trouble: CaseStatus | None = None


@dataclass(frozen=True, slots=True)
class JunitSuite:
    """What was looked at together.

    Attributes:
        took_s: seconds of the wall clock.
        properties: what was set for it.
    """

    name: str
    cases: Sequence[JunitCase]
    took_s: float = 0.0
    properties: Mapping[str, str] = field(default_factory=dict)


def write_junit(file: BinaryIO, name: str, suites: Sequence[JunitSuite]) -> None:
    """Write suites as one XML document; a case that has the name of another gets a number."""
    root = ElementTree.Element("testsuites", _counts(name, suites))
    for suite in suites:
        made = ElementTree.SubElement(root, "testsuite", _counts(suite.name, [suite]))
        if suite.properties:
            properties = ElementTree.SubElement(made, "properties")
            for key, value in suite.properties.items():
                said = {"name": printable(key), "value": printable(value)}
                ElementTree.SubElement(properties, "property", said)
        _add_cases(made, suite)
    ElementTree.indent(root)
    ElementTree.ElementTree(root).write(file, encoding="utf-8", xml_declaration=True)
    file.write(b"\n")


def _add_cases(suite: ElementTree.Element, said: JunitSuite) -> None:
    named: Counter[str] = Counter()
    for case in said.cases:
        named[case.name] += 1
        name = case.name if named[case.name] == 1 else f"{case.name} ({named[case.name]})"
        attributes = {"classname": printable(said.name), "name": printable(name)}
        made = ElementTree.SubElement(suite, "testcase", attributes)
        if case.trouble is not None:
            seen = printable(case.seen)
            ElementTree.SubElement(made, case.trouble.value, {"message": seen}).text = seen


def _counts(name: str, suites: Sequence[JunitSuite]) -> dict[str, str]:
    troubles = Counter(case.trouble for suite in suites for case in suite.cases)
    return {
        "name": printable(name),
        "tests": str(troubles.total()),
        "failures": str(troubles[CaseStatus.FAILURE]),
        "errors": str(troubles[CaseStatus.ERROR]),
        "skipped": str(troubles[CaseStatus.SKIPPED]),
        "time": f"{sum(suite.took_s for suite in suites):.3f}",
    }
