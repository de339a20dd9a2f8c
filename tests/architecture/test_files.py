"""What keeps the house readable: short files, and a page at the door of each room."""

from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[2]
ROOMS = ("executive", "trees", "adapters", "sim")
MOST_LINES = 600
GENERATED = ", written by adapters.mal." + "generate from "


def test_no_file_is_too_long() -> None:
    lengths = {
        str(path.relative_to(CHECKOUT)): len(path.read_text().splitlines())
        for room in (*ROOMS, "tests")
        for path in (CHECKOUT / room).rglob("*.py")
        if GENERATED not in path.read_text()
    }
    assert {path: lines for path, lines in lengths.items() if lines > MOST_LINES} == {}


def test_every_room_says_what_it_is_for() -> None:
    folders = {path.parent for room in ROOMS for path in (CHECKOUT / room).rglob("*.py")}
    folders |= {CHECKOUT / room for room in (*ROOMS, "config", "tests")}
    silent = [folder for folder in folders if not (folder / "README.md").is_file()]
    assert sorted(str(folder.relative_to(CHECKOUT)) for folder in silent) == []
