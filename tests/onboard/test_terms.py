"""The executive's link as its options say: TLS, encodings, and why it cannot start."""

import re
from pathlib import Path

import pytest

from adapters.mal import Encoding
from adapters.mrs.terms import Terms
from executive.commands.catalogue import SetTravelSpeed
from tests.support.certificates import Ends, make_ends, options
from tests.support.ground import ask, carry_out
from tests.support.processes import executive, running

pytestmark = pytest.mark.ros

CANNOT_START, USAGE = 1, 2


@pytest.fixture(scope="module")
def ends(module_ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Ends:
    assert module_ros_domain
    return make_ends(tmp_path_factory.mktemp("certificates"))


def test_commands_go_over_tls_and_in_another_encoding(tmp_path: Path, ends: Ends) -> None:
    told = (*options(ends.rover), "--encoding", "split", "--host", "0.0.0.0")
    with executive(tmp_path, *told) as (_, uri):
        reached = uri.replace("0.0.0.0", "127.0.0.1")
        terms = Terms(Encoding.SPLIT, ends.ground)
        (outcome,) = carry_out(reached, SetTravelSpeed(0.5), terms=terms)
        assert outcome.executed
        assert ask(reached, lambda client: client.get_speeds(), terms).travelSpeed == 0.5
        for wrong, why in (
            (Terms(Encoding.SPLIT, ends.stranger), "does not believe this certificate"),
            (Terms(Encoding.SPLIT), "does it ask for certificates"),
        ):
            with pytest.raises(ConnectionError, match=why):
                carry_out(reached, SetTravelSpeed(0.5), terms=wrong)


@pytest.mark.usefixtures("module_ros_domain")
@pytest.mark.parametrize(
    ("typed", "status", "why"),
    [
        (["--host", "0.0.0.0"], CANNOT_START, "give --certificate.*or add --clear-text"),
        (["--certificate", "rover.pem"], USAGE, "TLS needs all three"),
        (["--encoding", "xml"], USAGE, "'xml' is not one of"),
        (
            ["--certificate", "gone.pem", "--key", "gone.key", "--authorities", "gone.ca"],
            CANNOT_START,
            "Error: TLS: gone.pem: No such file or directory; .*PEM files that this process can",
        ),
    ],
)
def test_terms_that_make_no_sense(tmp_path: Path, typed: list[str], status: int, why: str) -> None:
    told = ("--port", "0", "--data", str(tmp_path / "data"), *typed)
    with running(tmp_path / "log", "rover-executive", *told) as process:
        assert process.ended() == status
        assert re.search(why, process.text)
        assert "Traceback" not in process.text
