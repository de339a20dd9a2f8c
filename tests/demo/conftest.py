from dataclasses import dataclass

import pytest

from tests.demo.playing import Demo, Ran


@dataclass(frozen=True, slots=True)
class Played:
    """The demonstrations of one rover."""

    jackal: Ran
    mocup: Ran
    relay: Ran


@pytest.fixture(scope="session")
def played(tmp_path_factory: pytest.TempPathFactory) -> Played:
    """Give them as they ended; they wait more than they work, so all are played at once."""
    folder = tmp_path_factory.mktemp("demo")
    jackal = Demo(folder / "jackal")
    mocup, relay = (Demo(folder / name, f"--{name}") for name in ("mocup", "relay"))
    try:
        return Played(jackal.ran(), mocup.ran(), relay.ran())
    finally:
        for demo in (jackal, mocup, relay):
            demo.clean_up()
