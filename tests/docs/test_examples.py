"""The examples work in an empty folder; with TEMPLATES, also by their literal command lines."""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from glob import glob
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml
from click.testing import CliRunner
from packaging.requirements import Requirement

from adapters.cli.main import main
from tests.architecture.test_packaging import PROJECT
from tests.docs.pages import CHECKOUT, PAGES, blocks, lines

BIN = Path(sys.executable).parent
EXAMPLES = CHECKOUT / "examples"
TEMPLATE = EXAMPLES / "ci"
INSTALL = "pip install --requirement requirements.txt"
LIMIT_S = 600
NAMED_EXTRAS = re.compile(
    r"(?:rover-executive|[ '\"]\.|\.whl)\[([a-z,]+)\]|\bextras?\s((?:`[a-z]+`(?:,\s|\sand\s)?)+)"
)
LITERALLY = pytest.mark.skipif(
    "TEMPLATES" not in os.environ, reason="./rover test --stress runs it, in processes of its own"
)


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    """Give a repository that was made of the template."""
    return Path(shutil.copytree(TEMPLATE, tmp_path / "repository"))


def run(line: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a command line in a shell, with the commands of an installation on the path."""
    variables = {
        **os.environ,
        "PATH": f"{BIN}{os.pathsep}{os.environ['PATH']}",
        "MPLBACKEND": "agg",
    }
    variables.pop("ROVER_CONFIG", None)
    return subprocess.run(
        ["sh", "-ec", line],
        cwd=folder,
        env=variables,
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        check=False,
    )


def workflow_lines() -> list[str]:
    """Return the commands of the workflow of GitHub Actions."""
    text = (TEMPLATE / ".github" / "workflows" / "scenarios.yml").read_text(encoding="utf-8")
    (job,) = yaml.safe_load(text)["jobs"].values()
    return [step["run"] for step in job["steps"] if "run" in step]


def pipeline_lines() -> list[str]:
    """Return the commands of the pipeline of GitLab."""
    text = (TEMPLATE / ".gitlab-ci.yml").read_text(encoding="utf-8")
    script: list[str] = yaml.safe_load(text)["scenarios"]["script"]
    return script


def test_all_run_the_same_commands() -> None:
    typed = [line.text for line in lines(TEMPLATE / "README.md")]
    assert [line.replace(".venv/bin/", "") for line in typed[1:]] == workflow_lines()
    assert pipeline_lines() == workflow_lines()
    assert workflow_lines()[0] == INSTALL


def test_the_template_installs_this_version() -> None:
    *comments, wheel = (TEMPLATE / "requirements.txt").read_text().splitlines()
    name = PROJECT["name"].replace("-", "_")
    assert wheel == f"./wheels/{name}-{PROJECT['version']}-py3-none-any.whl[sim]"
    released = Requirement(comments[-1].split()[-1])
    assert released.name == PROJECT["name"]
    assert released.specifier.contains(PROJECT["version"])


def test_named_extras_exist() -> None:
    paths = [*PAGES, *EXAMPLES.rglob("*.*")]
    texts = {path: path.read_text(encoding="utf-8") for path in paths if path.is_file()}
    found = {
        (path.name, extra)
        for path, text in texts.items()
        for names in NAMED_EXTRAS.findall(text)
        for extra in re.findall(r"[a-z]+", re.sub(r"\sand\s", ",", "".join(names)))
    }
    assert len(found) > 10
    assert {each for each in found if each[1] not in PROJECT["optional-dependencies"]} == set()


def test_the_scenarios_pass(repository: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(repository)
    _, played = workflow_lines()
    program, *arguments = played.removesuffix(" --out pictures").split()
    names = [name for each in arguments for name in sorted(glob(each)) or [each]]
    done = CliRunner().invoke(main, names, prog_name=program, catch_exceptions=False)
    assert done.exit_code == 0, done.output
    assert len(ElementTree.parse("results.xml").findall("testsuite")) == 2


@LITERALLY
def test_the_workflow_passes_with_results_and_pictures(repository: Path) -> None:
    _, play = workflow_lines()
    done = run(play, repository)
    assert done.returncode == 0, done.stdout + done.stderr
    names = {path.stem for path in (repository / "scenarios").iterdir()}
    suites = ElementTree.parse(repository / "results.xml").findall("testsuite")
    assert len(suites) == len(names)
    drawn = {
        path.relative_to(repository / "pictures").as_posix() for path in repository.rglob("*.png")
    }
    assert {f"{name}/{picture}.png" for name in names for picture in ("map", "timeline")} <= drawn
    ignored = (repository / ".gitignore").read_text().split()
    assert {"pictures/", "results.xml"} <= set(ignored)


@LITERALLY
def test_the_workflow_fails_where_an_expectation_is_not_met(repository: Path) -> None:
    path = repository / "scenarios" / "stop_is_a_stop.yaml"
    text = path.read_text()
    path.write_text(text.replace("ends: REJECTED", "ends: EXECUTED"))
    assert path.read_text() != text
    (repository / "scenarios" / "first_drive.yaml").unlink()
    failed = run(workflow_lines()[1].replace(" --out pictures", ""), repository)
    assert failed.returncode == 1
    assert ElementTree.parse(repository / "results.xml").find(".//failure") is not None


def test_the_page_names_these_commands(tmp_path: Path) -> None:
    copied, played = blocks(CHECKOUT / "docs" / "use-in-ci.md", "console")
    (tmp_path / "examples").symlink_to(EXAMPLES)
    (tmp_path / "runs").mkdir()
    assert run(copied, tmp_path).returncode == 0
    assert (tmp_path / "runs" / "my-rover" / ".gitlab-ci.yml").is_file()
    assert played.splitlines() == workflow_lines()


@LITERALLY
def test_the_notebook_runs(tmp_path: Path) -> None:
    notebook = json.loads((EXAMPLES / "recording.ipynb").read_text(encoding="utf-8"))
    assert notebook["nbformat"] == 4
    cells = [each for each in notebook["cells"] if each["cell_type"] == "code"]
    assert all(each["outputs"] == [] for each in cells)
    program = tmp_path / "cells.py"
    program.write_text("\n\n".join("".join(each["source"]) for each in cells), encoding="utf-8")
    done = run(f"{shlex.quote(sys.executable)} cells.py", tmp_path)
    assert done.returncode == 0, done.stderr
    assert re.search(r"MOE:1 .* FAILED\n", done.stdout)
    assert re.search(r"driven at up to 1\.\d\d m/s, \d+ messages", done.stdout)
