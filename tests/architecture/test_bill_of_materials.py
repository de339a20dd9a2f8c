"""No package is missing from a bill of materials, and none prevents our licence."""

from adapters.console.vendor.__main__ import FILES
from tests.bill_of_materials import (
    PERMITTED,
    REFUSED,
    licences,
    locked,
    missing,
    notices,
    vendored,
)


def test_a_missing_or_other_version_is_found() -> None:
    wanted = {"click": "8.4.0", "pyyaml": "6.0.3", "openmct": "4.2.0"}
    found = [{"name": "PyYAML", "version": "6.0.3"}, {"name": "click", "version": "8.3.0"}]
    assert missing(found, wanted) == ["click 8.4.0", "openmct 4.2.0"]
    assert locked()["click"]
    assert vendored().keys() <= {package for _, package in FILES}


def test_no_licence_prevents_ours() -> None:
    found = dict(licences())
    assert len(found) > 20
    # The wheels of ROS name none; their packages are under Apache-2.0 and BSD licences.
    assert [name for name, each in found.items() if not each and not name.startswith("ros-")] == []
    refused = [
        f"{name}: {licence}"
        for name, licence in found.items()
        if REFUSED.search(licence) and not PERMITTED.search(licence)
    ]
    assert refused == []


def test_the_notices_have_each_text() -> None:
    component = {
        "name": "a",
        "version": "1",
        "licenses": [{"license": {"id": "MIT", "text": {"content": "Permission is granted"}}}],
    }
    text = "\n".join(notices([component]))
    assert "a 1" in text
    assert "MIT\nPermission is granted" in text
