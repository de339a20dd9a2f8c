"""The connection of a page, in the Node.js that comes with Playwright."""

import json
import shutil
import subprocess
from pathlib import Path

import playwright

from tests.docs.pages import CHECKOUT

NODE = Path(playwright.__file__).parent / "driver" / "node"
SCRIPT = Path(__file__).with_name("connection.mjs")
CONNECTION = CHECKOUT / "adapters/console/static/app/model/connection.js"


def test_a_page_connects_again_after_a_silence(tmp_path: Path) -> None:
    (tmp_path / "package.json").write_text('{"type": "module"}')  # for any Node.js
    module = shutil.copytree(CONNECTION.parent, tmp_path / "model") / CONNECTION.name
    done = subprocess.run((NODE, SCRIPT, module), check=True, capture_output=True, text=True)
    assert json.loads(done.stdout) == {
        "before": {"sockets": 1, "status": "open"},
        "silent": {"sockets": 2, "status": "lost"},
        "back": {"sockets": 2, "status": "open", "told": ["hello", "hello"]},
    }
