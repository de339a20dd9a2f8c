"""`write_junit`: JUnit XML for continuous integration, with passed and failed cases and errors."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum, unique
from typing import BinaryIO
from xml.etree import ElementTree

from executive.values.reports import printable


@unique
class CaseStatus(Enum):
    """Reason why a case did not pass; the value is the name of its XML element."""

    FAILURE = "failure"
    """The case was evaluated and failed."""
    ERROR = "error"
    """The case could not be evaluated."""
    SKIPPED = "skipped"
    """The case failed and is not required to pass."""


@dataclass(frozen=True, slots=True)
class JunitCase:
    """One check.

    Attributes:
        trouble: None if it passed.
    """

    name: str
    observed: str
    trouble: CaseStatus | None = None


@dataclass(frozen=True, slots=True)
class JunitSuite:
    """Checks that belong together.

    Attributes:
        took_s: duration by the wall clock, in seconds.
        properties: configuration of the run, such as its seed.
    """

    name: str
    cases: Sequence[JunitCase]
    took_s: float = 0.0
    properties: Mapping[str, str] = field(default_factory=dict)


def write_junit(file: BinaryIO, name: str, suites: Sequence[JunitSuite]) -> None:
    """Write suites as one XML document; a case with the name of another gets a number."""
    root = ElementTree.Element("testsuites", _counts(name, suites))
    for suite in suites:
        made = ElementTree.SubElement(root, "testsuite", _counts(suite.name, [suite]))
        if suite.properties:
            properties = ElementTree.SubElement(made, "properties")
            for key, value in suite.properties.items():
                attributes = {"name": printable(key), "value": printable(value)}
                ElementTree.SubElement(properties, "property", attributes)
        _add_cases(made, suite)
    ElementTree.indent(root)
    ElementTree.ElementTree(root).write(file, encoding="utf-8", xml_declaration=True)
    file.write(b"\n")


def _add_cases(suite: ElementTree.Element, content: JunitSuite) -> None:
    named: Counter[str] = Counter()
    for case in content.cases:
        named[case.name] += 1
        name = case.name if named[case.name] == 1 else f"{case.name} ({named[case.name]})"
        attributes = {"classname": printable(content.name), "name": printable(name)}
        made = ElementTree.SubElement(suite, "testcase", attributes)
        if case.trouble is not None:
            observed = printable(case.observed)
            ElementTree.SubElement(made, case.trouble.value, {"message": observed}).text = observed


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
