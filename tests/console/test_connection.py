"""The connection of a page, in the Node.js that comes with Playwright."""

import json
import shutil
import subprocess
from pathlib import Path

import playwright

from tests.docs.pages import CHECKOUT

NODE = Path(playwright.__file__).parent / "driver" / "node"
SCRIPT = Path(__file__).with_name("connection.mjs")
ABORTED = """
const { fetchJson } = await import(process.argv[1]);
globalThis.fetch = async (_, { signal }) => {
    signal.throwIfAborted();
    throw new TypeError("Failed to fetch");
};
const named = [];
const note = ({ name, status }) => named.push(name, status ?? null);
for (const signal of [AbortSignal.abort(), new AbortController().signal])
    await fetchJson("/api", { signal }).catch(note);
console.log(JSON.stringify(named));
"""
CONNECTION = CHECKOUT / "adapters/console/static/app/model/connection.js"


def module_in(folder: Path) -> Path:
    (folder / "package.json").write_text('{"type": "module"}')  # for any Node.js
    return shutil.copytree(CONNECTION.parent, folder / "model") / CONNECTION.name


def test_a_page_connects_again_after_a_silence(tmp_path: Path) -> None:
    module = module_in(tmp_path)
    done = subprocess.run((NODE, SCRIPT, module), check=True, capture_output=True, text=True)
    assert json.loads(done.stdout) == {
        "before": {"sockets": 1, "status": "open"},
        "silent": {"sockets": 2, "status": "lost"},
        "back": {"sockets": 2, "status": "open", "told": ["hello", "hello"]},
    }


def test_an_aborted_request_is_no_error_of_the_console(tmp_path: Path) -> None:
    command = (NODE, "--input-type=module", "-e", ABORTED, module_in(tmp_path))
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    assert json.loads(done.stdout) == ["AbortError", None, "Error", 0]
