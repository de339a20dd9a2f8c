"""One name, version and list of commands for pip, colcon and ROS; nothing left out of the wheel."""

import ast
import os
import re
import subprocess
import sys
import tomllib
import zipfile
from importlib.metadata import EntryPoint, entry_points, packages_distributions, version
from pathlib import Path
from xml.etree import ElementTree

import click
import pytest
import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.support.wheel import PACKAGES, build_wheel

CHECKOUT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())["project"]
COMMANDS = PROJECT["entry-points"]["rover.commands"]
CHECKOUT_COMMANDS = tomllib.loads((CHECKOUT / "tests" / "commands.toml").read_text())
ROS_NAME = PROJECT["name"].replace("-", "_")
# How colcon reads a setup.py: what it prints must be literals.
AS_COLCON = """
import setuptools
from distutils.core import run_setup
dist = run_setup("setup.py", stop_after="config")
unread = {"cmdclass", "distclass", "ext_modules", "metadata", *dist.display_option_names}
shown = {
    key: value for key, value in vars(dist).items()
    if not (key.startswith("_") or callable(value) or key in unread)
}
shown["metadata"] = {
    key: value for key, value in vars(dist.metadata).items()
    if key not in ("license_files", "provides_extras")
}
print(shown)
"""


def files(package: str) -> list[Path]:
    return [
        path.relative_to(CHECKOUT)
        for path in (CHECKOUT / package).rglob("*")
        if path.is_file() and path.suffix not in {".pyc", ".md"}
    ]


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder where the wheel is unpacked."""
    target = tmp_path_factory.mktemp("installed")
    zipfile.ZipFile(build_wheel(tmp_path_factory.mktemp("built"))).extractall(target)
    return target


@pytest.fixture(scope="module")
def wheel(installed: Path) -> set[str]:
    """Return the names of the files in the wheel."""
    return {str(path.relative_to(installed)) for path in installed.rglob("*") if path.is_file()}


def test_ros_and_python_agree() -> None:
    package = ElementTree.parse(CHECKOUT / "package.xml")
    assert package.findtext("name") == ROS_NAME
    assert package.findtext("version") == PROJECT["version"] == version(PROJECT["name"])
    assert package.findtext("description") == PROJECT["description"]
    citation = yaml.safe_load((CHECKOUT / "CITATION.cff").read_text(encoding="utf-8"))
    assert (citation["version"], citation["license"]) == (PROJECT["version"], "Apache-2.0")
    assert (CHECKOUT / "resource" / ROS_NAME).is_file()
    assert f"$base/lib/{ROS_NAME}" in (CHECKOUT / "setup.cfg").read_text()


def test_installed_commands_are_those_of_the_project() -> None:
    installed = {entry.name: entry.value for entry in entry_points(group="rover.commands")}
    assert installed == COMMANDS


@pytest.mark.parametrize(("name", "value"), [*COMMANDS.items(), *CHECKOUT_COMMANDS.items()])
def test_command_is_that_of_its_entry_point(name: str, value: str) -> None:
    command = EntryPoint(name, value, "rover.commands").load()
    assert isinstance(command, click.Command)
    assert command.name == name
    assert command.get_short_help_str()


def test_a_command_of_a_checkout_does_all_that_the_installed_one_does() -> None:
    (name,) = COMMANDS.keys() & CHECKOUT_COMMANDS.keys()
    installed, replaced = (
        EntryPoint(name, table[name], "rover.commands").load()
        for table in (COMMANDS, CHECKOUT_COMMANDS)
    )
    assert installed.commands.items() < replaced.commands.items()


@pytest.mark.parametrize("name", PROJECT["scripts"])
def test_script_is_that_of_its_entry_point(name: str) -> None:
    (entry,) = entry_points(group="console_scripts", name=name)
    assert callable(entry.load())


def test_colcon_can_read_the_project() -> None:
    read = subprocess.run(
        [sys.executable, "-c", AS_COLCON], cwd=CHECKOUT, check=True, capture_output=True, text=True
    )
    project = ast.literal_eval(read.stdout)
    assert project["metadata"]["name"] == PROJECT["name"]
    assert set(PACKAGES) <= set(project["packages"])
    assert len(project["entry_points"]["console_scripts"]) == len(PROJECT["scripts"])
    assert f"share/{ROS_NAME}" in dict(project["data_files"])


def test_our_top_level_names_are_ours_alone() -> None:
    owners = packages_distributions()
    assert [set(owners[package]) for package in PACKAGES] == [{PROJECT["name"]}] * len(PACKAGES)


def test_every_folder_with_code_is_a_typed_package() -> None:
    for package in PACKAGES:
        assert (CHECKOUT / package / "py.typed").is_file()
        folders = {path.parent for path in files(package) if path.suffix == ".py"}
        assert [
            str(path) for path in folders if not (CHECKOUT / path / "__init__.py").exists()
        ] == []


def test_wheel_holds_all_code_and_data(wheel: set[str]) -> None:
    for package in PACKAGES:
        assert {str(path) for path in files(package)} - wheel == set()
    share = f"{ROS_NAME}-{PROJECT['version']}.data/data/share/"
    settings = {
        f"{share}{ROS_NAME}/{path}" for folder in ("config", "launch") for path in files(folder)
    } | {f"{share}{ROS_NAME}/docs/{path.name}" for path in (CHECKOUT / "docs").glob("*.md")}
    marker = f"{share}ament_index/resource_index/packages/{ROS_NAME}"
    assert settings | {marker, f"{share}{ROS_NAME}/package.xml"} <= wheel


def test_wheel_brings_no_other_top_level_name(wheel: set[str]) -> None:
    tops = {name.split("/")[0] for name in wheel}
    assert {top for top in tops if not top.startswith(f"{ROS_NAME}-")} == {
        *PACKAGES,
        f"{ROS_NAME}.py",
    }


def rover(installed: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run `rover` as it is in the wheel, from where there is no checkout."""
    return subprocess.run(
        [sys.executable, "-c", "from adapters.cli.main import main; main()", *arguments],
        cwd=installed,
        env={"PYTHONPATH": str(installed), "PATH": os.environ["PATH"]},
        capture_output=True,
        text=True,
    )


def test_a_bare_install_has_no_command_that_needs_a_checkout(installed: Path) -> None:
    listed = rover(installed, "--help")
    assert listed.returncode == 0, listed.stderr
    assert set(re.findall(r"^  (\w+)  +[A-Z]", listed.stdout, re.MULTILINE)) == set(COMMANDS)
    for command in CHECKOUT_COMMANDS.keys() - COMMANDS:
        refused = rover(installed, command)
        assert refused.returncode == 2
        assert f"\n\nError: No such command '{command}'." in refused.stderr


RUNS = ("ros", "onboard", "ground", "sim")
"""Extras of requirements.lock; requirements-test.lock has all."""
LOCKS = {
    name: (CHECKOUT / name).read_text() for name in ("requirements.lock", "requirements-test.lock")
}
EXTRAS = PROJECT["optional-dependencies"]
WANTED = [
    (name, line)
    for name in LOCKS
    for line in (
        *PROJECT["dependencies"],
        *(
            line
            for extra, lines in EXTRAS.items()
            if "test" in name or extra in RUNS
            for line in lines
        ),
    )
]


def entries(lock: str) -> list[str]:
    """Return one string for each requirement, with the lines that belong to it."""
    text = "".join(
        line for line in LOCKS[lock].splitlines(keepends=True) if not line.startswith("#")
    )
    return re.split(r"\n(?=\S)", text.strip())


@pytest.mark.parametrize("lock", LOCKS)
def test_every_entry_is_pinned_and_hashed(lock: str) -> None:
    assert len(entries(lock)) > 50
    for entry in entries(lock):
        assert re.match(r"[a-z0-9-]+==\S+ (; .+ )?\\\n", entry), entry
        assert re.fullmatch(r"(\s+--hash=sha256:[0-9a-f]{64}( \\\n)?)+", entry[entry.index("\n") :])


@pytest.mark.parametrize("lock", LOCKS)
def test_names_no_host(lock: str) -> None:
    assert not re.search(r"https?:|file:|index-url|find-links|trusted-host", LOCKS[lock])


@pytest.mark.parametrize(("lock", "wanted"), WANTED)
def test_holds_the_files_required_by_pyproject(lock: str, wanted: str) -> None:
    requirement = Requirement(wanted)
    pinned = [Requirement(entry.split("\\")[0]) for entry in entries(lock)]
    versions = [
        next(iter(pin.specifier)).version
        for pin in pinned
        if canonicalize_name(pin.name) == canonicalize_name(requirement.name)
    ]
    assert versions
    assert all(requirement.specifier.contains(version) for version in versions)


def test_the_second_lock_adds_to_the_first() -> None:
    runs, everything = map(entries, LOCKS)
    assert set(runs) < set(everything)


def test_what_runs_brings_nothing_of_tests_and_nothing_large() -> None:
    others = {
        canonicalize_name(Requirement(line).name)
        for extra, lines in EXTRAS.items()
        if extra not in RUNS
        for line in lines
    }
    names = {entry.partition("==")[0] for entry in entries("requirements.lock")}
    assert names & others == {"setuptools"}  # which installs the checkout itself
