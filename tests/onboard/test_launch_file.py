"""The launch file, as far as it can be looked at without launch, which the wheels do not have."""

import ast
from pathlib import Path

from adapters.onboard.process import parser

LAUNCH_FILE = Path(__file__).parents[2] / "launch" / "rover.launch.py"


def test_arguments_are_options_of_the_process_with_its_defaults() -> None:
    module = ast.parse(LAUNCH_FILE.read_text())
    (options,) = (
        ast.literal_eval(node.value)
        for node in module.body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "OPTIONS"
    )
    words = [word for name, (text, _) in options.items() if text for word in (f"--{name}", text)]
    assert parser().parse_args(words) == parser().parse_args([])
    files = ("certificate", "key", "authorities")
    assert {name for name, (text, _) in options.items() if not text} == set(files)
    taken = parser().parse_args([word for name in files for word in (f"--{name}", "a.pem")])
    assert [str(vars(taken)[name]) for name in files] == ["a.pem"] * 3
