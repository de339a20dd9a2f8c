"""The images of `Containerfile`, built and started by the commands of docs/containers.md.

They are built by buildah on a Debian that debootstrap makes, since no registry of images may be
within reach, and run in its isolation by chroot, which needs no control groups. It needs root,
Debian's mirror and the package index; `rover test --stress` runs it.
"""

import os
import re
import shutil
import subprocess
import urllib.request
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import psutil
import pytest
import yaml

from tests.docs.pages import blocks
from tests.stress.debian_roots import COPIED, mirror
from tests.support.browser import REQUIRED
from tests.support.ports import free_ports
from tests.support.processes import LISTENS, Running
from tests.support.wheel import CHECKOUT

PAGE = CHECKOUT / "docs" / "containers.md"
BASE = "localhost/rover-base"
END_TIMEOUT_S = 30.0
SERVICES = yaml.safe_load((CHECKOUT / "compose.yaml").read_text())["services"]
RUNS = {
    "onboard": (("rover-executive", "rover-relay", "rover-nxt"), ("mujoco", "aiohttp", "mypy")),
    "ground": (("rover-console", "rover-mops", "rover"), ("rclpy", "mujoco", "mypy")),
    "sim": (("rover-sim", "rover-executive", "rover-console"), ("mypy", "playwright")),
}
"""Of each stage the programs that must start, and packages that it must not have."""

pytestmark = [
    pytest.mark.skipif(os.geteuid() != 0, reason="debootstrap and buildah need root here"),
    *(
        pytest.mark.skipif(
            shutil.which(tool) is None and not REQUIRED, reason=f"apt install {tool}"
        )
        for tool in ("buildah", "debootstrap")
    ),
]


@dataclass(frozen=True, slots=True)
class Builder:
    """A store of images of its own."""

    store: Path

    def command(self, *arguments: str) -> tuple[str, ...]:
        folders = ("--root", f"{self.store}/images", "--runroot", f"{self.store}/state")
        return ("buildah", *folders, *arguments)

    def do(self, *arguments: str, cwd: Path | None = None) -> str:
        done = subprocess.run(
            self.command(*arguments), cwd=cwd, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, f"{arguments}\n{done.stdout[-3000:]}{done.stderr[-3000:]}"
        return done.stdout.strip()

    def build(self, stage: str) -> str:
        """Build a stage by the page's command; return its image."""
        (line,) = (
            each.split()
            for each in "".join(blocks(PAGE, "bash")).splitlines()
            if f"--target {stage} " in each
        )
        assert line[:2] == ["podman", "build"]
        options = ("--isolation", "chroot", "--layers", "--build-arg", f"BASE={BASE}")
        self.do("build", *options, *line[2:], cwd=CHECKOUT)
        return line[line.index("--tag") + 1]

    def run(self, image: str, *arguments: str, **variables: str) -> tuple[str, ...]:
        """Return the command that starts a program in a new container, on this host's network."""
        given = (f"--env={name}={value}" for name, value in variables.items())
        container = self.do("from", "--pull-never", image)
        return self.command("run", "--isolation", "chroot", *given, container, "--", *arguments)


def end(running: Running) -> None:
    """End a container's processes, which a killed buildah would leave."""
    processes = psutil.Process(running.pid).children(recursive=True)
    for process in processes:
        process.terminate()
    _, alive = psutil.wait_procs(processes, timeout=END_TIMEOUT_S)
    running.clean_up()
    assert not alive


@pytest.fixture(scope="module")
def builder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Builder]:
    """Return a builder that has the base image."""
    folder = tmp_path_factory.mktemp("containers")
    root, builder = folder / "root", Builder(folder / "store")
    done = subprocess.run(
        ("debootstrap", "--variant=minbase", "--include=ca-certificates", "trixie", root, mirror()),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-2000:]
    for name in filter(os.path.isfile, COPIED):
        shutil.copyfile(name, f"{root}{name}")
    container = builder.do("from", "scratch")
    builder.do("add", "--quiet", container, str(root), "/")
    builder.do("commit", "--quiet", "--rm", container, BASE)
    shutil.rmtree(root)
    yield builder
    builder.do("rm", "--all")
    builder.do("rmi", "--all", "--force")


@pytest.mark.parametrize("stage", RUNS)
def test_an_image_has_its_programs_and_nothing_of_others(stage: str, builder: Builder) -> None:
    image = builder.build(stage)
    programs, absent = RUNS[stage]
    tried = "; ".join(f"{program} --help >/dev/null || exit 1" for program in programs)
    found = " || ".join(f"python -c 'import {package}' 2>/dev/null" for package in absent)
    command = builder.run(image, "sh", "-c", f"{tried}; id -un; test ! -w /opt/rover; {found}")
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.stdout == "rover\n", done.stderr
    assert done.returncode == 1, f"{image} has one of {absent}"


@pytest.mark.usefixtures("ros_domain")
def test_the_services_of_the_compose_file_work_together(builder: Builder, tmp_path: Path) -> None:
    assert {service["network_mode"] for service in SERVICES.values()} == {"host"}
    domain = os.environ["ROS_DOMAIN_ID"]
    rover, console = free_ports(2)
    own = {"executive": ("--port", str(rover)), "console": ("--port", str(console))}
    ready = {"sim": "stands in world", "executive": LISTENS, "console": r"jackal is up"}
    with ExitStack() as stack:
        for name, service in SERVICES.items():
            image = builder.build(service["build"]["target"])
            assert image == service["image"]
            command = builder.run(
                image, *service["command"].split(), *own.get(name, ()),
                ROS_DOMAIN_ID=domain, ROVER_URI=f"127.0.0.1:{rover}",
            )  # fmt: skip
            running = Running(tmp_path / name, *command)
            stack.callback(end, running)
            running.output(ready[name])
        pattern = r"^podman run .* rover-ground (rover command .*)$"
        (line,) = re.findall(pattern, PAGE.read_text(), re.MULTILINE)
        command = builder.run("rover-ground", *line.split(), ROVER_URI=f"127.0.0.1:{rover}")
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        assert "EXECUTED" in done.stdout
        with urllib.request.urlopen(f"http://127.0.0.1:{console}/", timeout=60) as answer:
            assert b"Rover console" in answer.read()
