"""Two executives on one ledger: the second is refused."""

from pathlib import Path

import pytest

from tests.support.processes import executive, running


@pytest.mark.ros
@pytest.mark.usefixtures("ros_domain")
def test_a_second_process_on_one_ledger_is_refused(tmp_path: Path) -> None:
    with executive(tmp_path):
        arguments = ("--port", "0", "--data", str(tmp_path / "data"))
        with running(tmp_path / "second", "rover-executive", *arguments) as second:
            assert second.ended() == 1
            assert "another process" in second.text
            assert "Traceback" not in second.text
