"""The launch file, as far as it can be looked at without launch, which the wheels do not have."""

import ast
from pathlib import Path
from typing import Any

from adapters.onboard.process import main

LAUNCH_FILE = Path(__file__).parents[2] / "launch" / "rover.launch.py"


def test_arguments_are_options_of_the_process_with_its_defaults() -> None:
    module = ast.parse(LAUNCH_FILE.read_text())
    (options,) = (
        ast.literal_eval(node.value)
        for node in module.body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "OPTIONS"
    )
    words = [word for name, (text, _) in options.items() if text for word in (f"--{name}", text)]
    files = ("certificate", "key", "authorities")
    assert {name for name, (text, _) in options.items() if not text} == set(files)
    assert parsed(words) == parsed([])
    taken = parsed([word for name in files for word in (f"--{name}", "a.pem")])
    assert [str(taken[name]) for name in files] == ["a.pem"] * 3


def parsed(words: list[str]) -> dict[str, Any]:
    params: dict[str, Any] = main.make_context("rover-executive", words).params
    return params
