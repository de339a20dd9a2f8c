"""`rover doctor` checks this computer for the processes of a rover, and prints the remedies.

A check is a generator of results: level, text, and the command to type as the remedy.
"""

import errno
import json
import os
import re
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from enum import StrEnum
from importlib.metadata import distributions
from importlib.util import find_spec
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Any, Final

import click

from adapters.process import EXTRAS, NICE, asset_option, data_option, default_folder, program

if TYPE_CHECKING:
    from executive.settings import Settings

TESTED: Final = ("3.11", "3.12", "3.13", "3.14")
DISTROS: Final = ("", "jazzy", "kilted", "lyrical", "rolling")
RANGES: Final = ("", "SUBNET", "LOCALHOST", "OFF", "SYSTEM_DEFAULT")
FIRST_PORT, PORTS, MAX_DOMAIN = 7400, 250, 101
"""UDP ports of a DDS domain; those of higher domains overlap the ports that Linux assigns."""
GROUP: Final = "239.255.0.1"
"""Multicast group of the discovery of DDS."""
LISTEN_S: Final = 5.0
MAX_SYNC_S: Final = 0.1
"""Duration of a disk write above which reports are late; as in `rover status`."""
TIME_ERROR: Final = 5  # of adjtimex while the clock is not synchronised
NAVIGATION_PACKAGE: Final = "nav2_msgs"
USB: Final = Path("/sys/bus/usb/devices")
SHARED_MEMORY: Final = Path("/dev/shm")
SYNCHRONISE: Final = "sudo timedatectl set-ntp true"


class Level(StrEnum):
    """Level of a result; an error prevents operation."""

    OK = "ok"
    WARNING = "warning"
    ERROR = "error"


Results = Iterator[tuple[Level, str, str]]
OK, WARNING, ERROR = Level


@dataclass(frozen=True, slots=True)
class Subject:
    """Data folder, and the asset with its settings; without an asset the computer alone."""

    data: Path | None
    asset: str = ""
    settings: "Settings | None" = None
    namespace: str | None = None


def _guarded(check: Callable[[Subject], Results], subject: Subject) -> Results:
    """Yield the results of a check; an exception is one, too, and the other checks still run."""
    try:
        yield from check(subject)
    except Exception as error:
        yield ERROR, f"this check failed: {type(error).__name__}: {error}", ""


def _user() -> str:
    """Return the name of this process's user, or its number."""
    import pwd  # Windows has none, and `--ground` needs none

    with suppress(KeyError):
        return pwd.getpwuid(os.geteuid()).pw_name
    return str(os.geteuid())


def _install(extra: str) -> str:
    """Return the command that installs an extra: of the lock in a checkout."""
    pip = f"{quote(sys.executable)} -m pip install 'rover-executive[{extra}]'"
    return "./rover extras" if program() == "./rover" else pip


def _python(_: Subject) -> Results:
    text = f"{sys.version.split()[0]}; {', '.join(TESTED)} are supported"
    tested = "{}.{}".format(*sys.version_info) in TESTED
    yield (OK, text, "") if tested else (WARNING, text, "sudo apt install python3.13-venv")


def _packages(_: Subject) -> Results:
    missing = [name for name in EXTRAS if find_spec(name) is None]
    for extra in dict.fromkeys(EXTRAS[name] for name in missing):
        names = ", ".join(name for name in missing if EXTRAS[name] == extra)
        yield OK, f"the extra {extra} would install {names}", _install(extra)


def _clock(_: Subject) -> Results:
    import ctypes

    text = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime())
    timex = ctypes.create_string_buffer(512)  # mode 0: the clock is only read
    if time.time() < Path(__file__).stat().st_mtime:
        yield ERROR, f"{text} is before this program was installed", SYNCHRONISE
    elif sys.platform == "linux" and ctypes.CDLL(None).adjtimex(timex) == TIME_ERROR:
        yield WARNING, f"{text}, not synchronised: commands may expire too early", SYNCHRONISE
    else:
        yield OK, text, ""


def _ros(_: Subject) -> Results:
    found = [f"{each.name} {each.version}" for each in distributions() if each.name]
    wheels = [each for each in found if re.match("ros-[a-z]+-rclpy ", each)]
    sourced, distro = (os.environ.get(name, "") for name in ("AMENT_PREFIX_PATH", "ROS_DISTRO"))
    if find_spec("rclpy") is None:
        has_wheels = sys.platform == "linux" and os.uname().machine == "x86_64"
        remedy = _install("ros") if has_wheels else "sudo apt install ros-jazzy-ros-base"
        apt = sorted(Path("/opt/ros").glob("*/setup.sh"))
        yield ERROR, "no ROS: Python finds no rclpy", f". {apt[-1]}" if apt else remedy
    elif wheels and "/opt/ros/" in sourced:
        text = f"{wheels[0]} is installed beside a sourced {sourced}: their libraries mix"
        yield ERROR, text, 'env -i HOME="$HOME" PATH="$PATH" bash'
    elif distro not in DISTROS:
        yield WARNING, f"{distro} is older than Jazzy, or unknown", "ls /opt/ros"
    else:  # in a process of its own, which a wrong middleware ends
        code = "import rclpy; print(rclpy.get_rmw_implementation_identifier())"
        tried = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
        text = ["no error text", *tried.stderr.strip().splitlines()][-1]
        if tried.returncode:
            yield ERROR, f"rclpy does not start: {text}", "unset RMW_IMPLEMENTATION"
        else:
            yield OK, f"{(wheels or [distro])[0]} with {tried.stdout.strip()}", ""


def local_domains() -> set[int]:
    """Return the ROS domains of the nodes on this computer, by their UDP ports."""
    ports: set[int] = set()
    for table in ("/proc/net/udp", "/proc/net/udp6"):
        with suppress(OSError):
            rows = Path(table).read_text("ascii").splitlines()[1:]
            ports |= {int(row.split()[1].rpartition(":")[2], 16) for row in rows}
    bases = [(each, FIRST_PORT + PORTS * each) for each in range(MAX_DOMAIN + 1)]
    # The multicast port, or both unicast ports of a first participant.
    return {domain for domain, at in bases if at in ports or {at + 10, at + 11} <= ports}


def _domain(_: Subject) -> Results:
    text = os.environ.get("ROS_DOMAIN_ID") or "0"
    found, valid = sorted(local_domains()), text.isdecimal() and int(text) <= MAX_DOMAIN
    nodes = f"nodes on this computer: in {', '.join(map(str, found)) or 'no domain'}"
    if not valid:
        text = f"ROS_DOMAIN_ID is {text!r}: a number from 0 to {MAX_DOMAIN} is needed"
        yield ERROR, text, "export ROS_DOMAIN_ID=0"
    elif found and int(text) not in found:
        yield WARNING, f"ROS_DOMAIN_ID is {text}; {nodes}", f"export ROS_DOMAIN_ID={found[0]}"
    else:
        yield OK, f"ROS_DOMAIN_ID is {text}; {nodes}", ""
    if (reach := os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "")) not in RANGES:
        text = f"ROS_AUTOMATIC_DISCOVERY_RANGE is {reach!r}, not one of{' '.join(RANGES)}"
        yield ERROR, text, "unset ROS_AUTOMATIC_DISCOVERY_RANGE"
    for name in ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE"):
        if (profile := os.environ.get(name)) and not Path(profile).is_file():
            yield ERROR, f"{name}: there is no file {profile}", f"unset {name}"


def _discovery(_: Subject) -> Results:
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
            end.settimeout(1.0)
            end.bind(("", 0))
            membership = socket.inet_aton(GROUP) + bytes(4)
            end.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
            end.sendto(b"rover doctor", (GROUP, end.getsockname()[1]))
            end.recv(64)
        yield OK, f"multicast to {GROUP} is received", ""
    except OSError as error:
        text = f"multicast to {GROUP} fails: {error.strerror or error}"
        yield WARNING, text, f"sudo ip route add {GROUP}/32 dev lo"
    users: set[str] = set()
    for each in SHARED_MEMORY.glob("fast*"):
        with suppress(OSError):  # its process may end now
            users |= set() if os.access(each, os.W_OK) else {str(each.stat().st_uid)}
    if users and not os.environ.get("FASTDDS_BUILTIN_TRANSPORTS"):
        text = f"shared memory of Fast DDS is that of user {', '.join(users)}: no data arrives"
        yield WARNING, text, "export FASTDDS_BUILTIN_TRANSPORTS=UDPv4"


def _first(topic: str) -> str:
    """Return the outermost namespace of a topic."""
    return topic[: topic.find("/", 1)] if topic.count("/") > 1 else "/"


def _robot(subject: Subject) -> Results:
    if subject.settings is None:
        return
    from adapters.ros.check import check_robot

    topics = check_robot(subject.asset, LISTEN_S, subject.namespace, None).topics
    namespace = f" --namespace {subject.namespace}" if subject.namespace else ""
    remedy = f"{program()} robot check {subject.asset}{namespace}"
    expected = _first(topics[0].topic)
    near = {_first(name) for each in topics for name in each.others}
    present = expected in near or any(each.peers for each in topics)
    for each in topics if present else ():
        level = ERROR if each.key in ("odometry", "cmd_vel") else WARNING
        yield from ((level, f"{each.key}: {text}", remedy) for text in each.problems)
        if not each.problems:
            yield OK, f"{each.key}: {each.topic}", ""
    if near and not present:
        text = f"no node has a topic of {subject.asset} in namespace {expected}"
        text += f"; topics of their types are in {', '.join(sorted(near))}"
        yield ERROR, text, f"{program()} doctor --asset {subject.asset} --namespace {min(near)}"
    elif not present:
        own = os.environ.get("ROS_DOMAIN_ID") or "0"
        others = [str(each) for each in sorted(local_domains() - {int(own)})]
        text = f"no node has a topic of {subject.asset} in ROS domain {own}"
        text += f"; there are nodes in {', '.join(others)}" if others else ""
        yield ERROR, text, f"export ROS_DOMAIN_ID={others[0]}" if others else remedy


def _data(subject: Subject) -> Results:
    from adapters.mrs.spec import MIN_FREE_OCTETS
    from adapters.system import OPERATING_SYSTEM

    asset = subject.settings.asset if subject.settings else "jackal"
    path = (subject.data or default_folder(asset)).absolute()
    folder = next(each for each in (path, *path.parents) if os.path.exists(each))
    worst_s, quoted = 0.0, quote(str(folder))
    usage = f"du -xh {quoted} | sort -h | tail"
    try:
        free_octets = OPERATING_SYSTEM.free_octets(folder)
        with tempfile.TemporaryFile(dir=folder, buffering=0) as file:
            for _ in range(10):
                began_s = time.monotonic()
                file.write(bytes(4096))
                os.fsync(file.fileno())
                worst_s = max(worst_s, time.monotonic() - began_s)
        if locked := [each for each in path.glob("*.sqlite*") if not os.access(each, os.W_OK)]:
            raise PermissionError(errno.EACCES, f"no right to write {locked[0].name}")
    except OSError as error:
        remedies = {
            errno.ENOSPC: usage,
            errno.EROFS: f"sudo mount -o remount,rw $(findmnt -no TARGET -T {quoted})",
            errno.ENOTDIR: f"mv {quoted} {quoted}.old",
        }
        own = f"{'chown -R' if folder == path else 'install -d -o'} {_user()} {quote(str(path))}"
        yield ERROR, f"{path}: {error.strerror}", remedies.get(error.errno or 0, f"sudo {own}")
        return
    text = f"{path}: {free_octets / 1e6:,.0f} MB free, the slowest write {worst_s * 1e3:.1f} ms"
    if free_octets < MIN_FREE_OCTETS:
        text = f"{text}; {MIN_FREE_OCTETS / 1e6:.0f} MB are needed"
        yield ERROR, text, usage
    elif worst_s > MAX_SYNC_S:
        yield WARNING, f"{text}: reports wait for it", "export ROVER_DATA=FOLDER_ON_A_FASTER_DISK"
    else:
        yield OK, text, ""


def _priority(_: Subject) -> Results:
    own = os.getpriority(os.PRIO_PROCESS, 0)
    try:
        os.setpriority(os.PRIO_PROCESS, 0, min(own, NICE))
        os.setpriority(os.PRIO_PROCESS, 0, own)
        yield OK, f"nice {NICE} is permitted", ""
    except PermissionError:
        remedy = f"echo '{_user()} - nice {NICE}' | sudo tee /etc/security/limits.d/rover.conf"
        yield WARNING, f"nice {NICE} is permitted to units only: ticks may be late", remedy


def _port(_: Subject) -> Results:
    from adapters.mrs.spec import PORT

    try:
        with socket.create_server(("127.0.0.1", PORT)):
            yield OK, f"TCP {PORT} is free", ""
    except OSError as error:
        text = f"TCP {PORT}: {os.strerror(error.errno or 0)}; perhaps an executive runs"
        yield WARNING, text, f"ss -ltnp 'sport = :{PORT}'"


def _brick(subject: Subject) -> Results:
    if subject.settings is None:
        return
    from executive.settings import config_folder, load_yaml

    file = config_folder() / f"{subject.settings.asset}.nxt.yaml"
    if not file.is_file():
        return
    brick: Any = load_yaml(file)
    ids = next(iter(brick.values()))["ros__parameters"]["usb"]
    product = f"PRODUCT={ids['vendor_id']:x}/{ids['product_id']:x}/"
    texts = [each.read_text("ascii") for each in USB.glob("*/uevent")]
    names = [name for each in texts if product in each for name in re.findall("DEVNAME=(.+)", each)]
    if not names:
        yield WARNING, f"no brick is connected ({product[:-1]})", "lsusb"
    elif os.access(device := Path("/dev", names[0]), os.W_OK):
        yield OK, f"the brick is {device}", ""
    else:
        rules = config_folder() / "systemd" / "60-rover-nxt.rules"
        remedy = f"sudo cp {quote(str(rules))} /etc/udev/rules.d/ && sudo udevadm trigger"
        yield ERROR, f"no right to write {device}, the brick", remedy


def _navigation(subject: Subject) -> Results:
    if subject.settings is None or not subject.settings.offers_navigation:
        return
    if find_spec(NAVIGATION_PACKAGE) is None:
        distro = os.environ.get("ROS_DISTRO") or "jazzy"
        text = f"no {NAVIGATION_PACKAGE}: goals for the navigation fail, reason 771"
        yield ERROR, text, f"sudo apt install ros-{distro}-nav2-msgs"
    else:
        yield OK, f"{NAVIGATION_PACKAGE} is installed", ""


GROUND: Final = (_python, _packages, _clock)
ABOARD: Final = (_ros, _domain, _discovery, _data, _priority, _port, _brick, _navigation, _robot)
COLOURS: Final = {OK: "green", WARNING: "yellow", ERROR: "red"}


@click.command()
@asset_option("Check for this asset, too: its settings, its topics, its brick.", default="")
@data_option("ledger and files")
@click.option("--namespace", help="ROS namespace of the robot.  [default: the asset's name]")
@click.option("--ground", is_flag=True, help="Check only the needs of the ground's commands.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document, nothing else.")
@click.pass_context
def doctor(
    ctx: click.Context,
    asset: str,
    data: Path | None,
    namespace: str | None,
    ground: bool,
    as_json: bool,
) -> None:
    """Check this computer: Python, ROS, rights, clock, disk, discovery.

    It prints a line for each result, and below it the command that is the remedy. It changes
    nothing. With --asset it also listens to the robot, which has to run, and does not move.

    \b
    Examples:
      rover doctor
      rover doctor --asset robots/clearpath_j100 --namespace j100_0001
      rover doctor --ground

    \b
    Exit status:
      0  no errors; there may be warnings
      1  there are errors
      2  an argument or a file of the asset is invalid
    """
    settings = None
    if asset:
        from executive.settings import SettingsError, load_settings

        try:
            settings = load_settings(asset)
        except SettingsError as error:
            raise click.UsageError(str(error)) from error
    checks: tuple[Callable[[Subject], Results], ...] = GROUND if ground else GROUND + ABOARD
    rows: list[dict[str, str]] = []
    for check in checks:
        errors = {row["check"] for row in rows if row["level"] == ERROR}
        if check is _robot and errors & {"ros", "domain"}:
            break  # it would end, or raise
        for level, text, remedy in _guarded(check, Subject(data, asset, settings, namespace)):
            name = check.__name__[1:]
            rows.append({"check": name, "level": level, "text": text, "remedy": remedy})
            if not as_json:
                click.echo(f"{click.style(f'{level:8}', fg=COLOURS[level])}{name}: {text}")
                click.echo(f"          {remedy}\n" if remedy else "", nl=False)
    if as_json:
        click.echo(json.dumps(rows))
    ctx.exit(any(row["level"] == ERROR for row in rows))
