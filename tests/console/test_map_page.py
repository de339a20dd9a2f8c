"""Where a page draws targets that are in the map of a localisation."""

import json
import subprocess
from math import pi
from pathlib import Path

import pytest
from playwright import __file__ as playwright

from tests.docs.pages import CHECKOUT

NODE = Path(playwright).parent / "driver" / "node"
APP = CHECKOUT / "adapters/console/static/app"
SCRIPT = """
const { Asset } = await import(process.argv[1]);
const { samples, entry, points, frame } = JSON.parse(process.argv[2]);
const asset = new Asset("rover", entry);
for (const [key, utc, value] of samples) {
    asset.addSample({ key, link: "direct", utc, rx: utc, value, q: "good" });
}
const shown = (utc) => asset.inOdometry(points, frame, utc);
console.log(JSON.stringify([shown(null), shown(5), asset.inFrame({ x: 1, y: 0 }, frame)]));
"""
KEYS = ("EXEC_MAP_X", "EXEC_MAP_Y", "EXEC_MAP_HEADING")


def origin(utc: float, *figures: float | None) -> list[object]:
    return [[key, utc, figure] for key, figure in zip(KEYS, figures, strict=True)]


def shown(tmp_path: Path, frame: str | None, usual: str | None, *samples: object) -> list[object]:
    """Return what is drawn of (2, 1) now and at 5 s, and (1, 0) of the page in a frame."""
    module = tmp_path / "model"
    module.mkdir(exist_ok=True)
    for name in ("asset", "observable"):  # modules for any Node.js
        text = (APP / f"model/{name}.js").read_text().replace(".js", ".mjs")
        (module / f"{name}.mjs").write_text(text)
    given = {"entry": {"frame": usual}, "points": [{"x": 2, "y": 1}], "samples": list(samples)}
    if frame is not None:
        given["frame"] = frame
    command = (NODE, "--input-type=module", "-e", SCRIPT, module / "asset.mjs", json.dumps(given))
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    found: list[object] = json.loads(done.stdout)
    return found


@pytest.mark.parametrize(("frame", "usual"), [("map", "odom"), (None, "map")])
def test_targets_in_the_map_are_drawn_in_the_odometry_frame(
    tmp_path: Path, frame: str | None, usual: str
) -> None:
    first, moved = origin(4.0, 10.0, 0.0, pi / 2), origin(8.0, 0.0, 5.0, 0.0)
    now, past, clicked = shown(tmp_path, frame, usual, *first, *moved)
    assert now == [{"x": 2, "y": 6}]
    assert past == [{"x": pytest.approx(9.0), "y": pytest.approx(2.0)}]
    assert clicked == {"x": 1, "y": -5}
    lost = origin(9.0, None, None, None)
    assert shown(tmp_path, frame, usual, *first, *moved, *lost)[0] == now, "the last known"
    assert shown(tmp_path, frame, usual) == [[], [], None], "not drawn in a wrong place"


def test_other_targets_are_drawn_where_they_are(tmp_path: Path) -> None:
    known = origin(4.0, 10.0, 0.0, pi / 2)
    plain = [[{"x": 2, "y": 1}], [{"x": 2, "y": 1}], {"x": 1, "y": 0}]
    for frame, usual in (("odom", "map"), (None, "odom"), (None, None)):
        assert shown(tmp_path, frame, usual, *known) == plain
