from dataclasses import dataclass

import pytest

from tests.demo.playing import FASTER, Demo, Ran


@dataclass(frozen=True, slots=True)
class Played:
    """The demonstrations of one rover."""

    jackal: Ran
    mocup: Ran
    relay: Ran


@pytest.fixture(scope="session")
def played(tmp_path_factory: pytest.TempPathFactory) -> Played:
    """Give them as they ended. Each is played alone: they are timed, and two cores are few."""
    folder = tmp_path_factory.mktemp("demo")

    def play(name: str, *arguments: str) -> Ran:
        demo = Demo(folder / name, *arguments)
        try:
            return demo.ran()
        finally:
            demo.clean_up()

    return Played(
        play("jackal", *FASTER), play("mocup", "--mocup", *FASTER), play("relay", "--relay")
    )
