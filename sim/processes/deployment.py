"""`run_deployment` starts a simulated rover's processes, `run_relay` those of their relay."""

import re
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import cattrs
import yaml

from adapters.bundle import (
    Address,
    KeySettings,
    Listen,
    LtpLink,
    PolicySettings,
    SecuritySettings,
    engine_of,
    make_key,
    parse_eid,
)
from adapters.process import ROS_ARGS
from adapters.relay.orbiter import OrbiterSettings, RelayedRoverSettings, load_orbiter
from adapters.relay.rover import RelaySettings, load_relay
from executive.settings import LocomotionKind, Settings, SettingsError, config_folder, load_settings
from sim.processes.children import ChildProcess, ProcessGroup
from sim.processes.rover_address import (
    ANY_PORT,
    HOST,
    RoverAddress,
    free_tcp_port,
    free_udp_ports,
    is_free,
)

SILENT_AFTER_S: Final = 5.0
HEALTH_INTERVAL_S: Final = 1.0
"""Shorter than in `config/`, because simulated rovers do not run for hours."""
PLAN_END_S: Final = 86_400
"""End of a contact plan, longer than any run here."""
RATE_OCTETS_S: Final = 125_000


@dataclass(frozen=True, slots=True)
class Outage:
    """A time without contact, in whole seconds after a reference, as in contact plans."""

    begin_s: int
    end_s: int


def plan_text(
    outages: Sequence[Outage], start_utc_s: int, orbiter: int, rovers: Sequence[int]
) -> str:
    """Return a contact plan with contact in both directions outside of outages."""
    reference = time.strftime("@ %Y/%m/%d-%H:%M:%S", time.gmtime(start_utc_s))
    lines = [
        f"a contact +{begin_s} +{end_s} {sender} {receiver} {RATE_OCTETS_S}"
        for begin_s, end_s in _contacts(outages)
        for rover in rovers
        for sender, receiver in ((orbiter, rover), (rover, orbiter))
    ]
    return "\n".join([reference, *lines]) + "\n"


def _contacts(outages: Sequence[Outage]) -> Iterator[tuple[int, int]]:
    begin_s = 0
    for outage in (*outages, Outage(PLAN_END_S, PLAN_END_S)):
        if begin_s < outage.begin_s:
            yield begin_s, outage.begin_s
        begin_s = outage.end_s


LISTENS: Final = re.compile(r"listens at (maltcp://\S+)")


class Deployment(ProcessGroup):
    """A running rover.

    Attributes:
        address: ROS domain and port of the processes.
        aboard: data folder of the executive.
        speed: simulated seconds per second; with `paced`, the maximum.
        paced: whether simulated time waits for late ticks of the executive.
        round_trip_s: that of the simulated link before its executive, s; 0 without one.
    """

    def __init__(
        self,
        address: RoverAddress,
        settings: Settings,
        aboard: Path,
        speed: float | None,
        executive: ChildProcess,
        *others: ChildProcess,
        link: ChildProcess | None = None,
        round_trip_s: float = 0.0,
    ) -> None:
        super().__init__(*others, executive, *([link] if link else []))
        self.address = address
        self.settings = settings
        self.aboard = aboard
        self.speed, self.paced = speed or 1.0, speed is None
        self.round_trip_s = round_trip_s
        self._executive, self._link = executive, link

    @property
    def simulated_time(self) -> bool:
        """Whether the processes run in simulated time."""
        return self.paced or self.speed != 1.0

    async def uri(self) -> str:
        """Wait until the executive listens and return its URI.

        Raises:
            ChildError: a process ended.
        """
        return await self.wait_for_output(self._executive, LISTENS)

    async def ground_uri(self) -> str:
        """Wait as `uri` does, and return the address for clients: of the simulated link, if any."""
        uri = await self.uri()
        return uri if self._link is None else await self.wait_for_output(self._link, LISTENS)


@contextmanager
def run_deployment(
    address: RoverAddress,
    folder: Path,
    asset: str,
    world: str,
    seed: int,
    video_to: str | None = None,
    speed: float | None = 1.0,
    round_trip_s: float = 0.0,
) -> Iterator[Deployment]:
    """Yield a rover in a world; at the end the executive ends before the rover.

    Args:
        address: ROS domain and port of its processes.
        folder: created if missing; receives their logs, and the executive's data.
        asset: name of the asset, or its YAML file.
        world: name of the world, or its YAML file.
        seed: seed of all sensor noise.
        video_to: HOST:PORT of the ground's end of the video stream; None as in the asset.
        speed: simulated seconds per second, for all processes; None for real time that waits for
            late ticks of the executive.
        round_trip_s: light time of a simulated link, which has the port then; 0 for no link.
    """
    folder.mkdir(parents=True, exist_ok=True)
    aboard = folder / "aboard"
    environment = {"ROS_DOMAIN_ID": str(address.domain)}
    settings = load_settings(asset)
    with ExitStack() as running:

        def start(name: str, module: str, *arguments: str) -> ChildProcess:
            child = ChildProcess(name, module, ("--asset", asset, *arguments), folder, environment)
            running.callback(child.end)
            return child

        stream = None if settings.video is None else f"{HOST}:{free_udp_ports(1)[0]}"
        cable: tuple[str, ...] = ()
        if settings.locomotion is LocomotionKind.DELEGATED:
            bus = running.enter_context(TemporaryDirectory(prefix="rover-usb-"))
            cable = ("--usb-socket", f"{bus}/brick")
        # Rovers in one domain have separate clocks.
        clock = () if speed == 1.0 else (ROS_ARGS, "-r", f"/clock:=/{settings.asset}/clock")
        simulation = start(
            "simulation",
            "sim.ros.process",
            *("--world", world, "--seed", str(seed)),
            *(("--paced",) if speed is None else ("--speed", str(speed))),
            *(("--video-to", stream) if stream else ()),
            *cable,
            *clock,
        )
        followed = (*clock, "-p", "use_sim_time:=true") if clock else ()
        brick = (*cable, "--asset", settings.asset, "--data", str(aboard))  # it accepts names only
        between = (start("nxt", "sim.brick.nxt", *brick, *followed),) if cable else ()
        port = free_tcp_port() if round_trip_s else address.port
        executive = start(
            "executive",
            "adapters.onboard.process",
            *("--port", str(port), "--data", str(aboard)),
            *(() if cable else ("--relay",)),
            *(("--video-from", stream) if stream else ()),
            *(("--video-to", video_to) if stream and video_to else ()),
            *followed,
        )
        link = None
        if round_trip_s:
            ports = ("--to", f"{HOST}:{port}", "--port", str(address.port))
            options = (*ports, "--delay", f"{round_trip_s}s")
            link = ChildProcess("link", "sim.processes.delayed_link", options, folder, environment)
            running.callback(link.end)
        yield Deployment(
            *(address, settings, aboard, speed, executive, simulation, *between),
            link=link,
            round_trip_s=round_trip_s,
        )


def relay_settings(
    rovers: Sequence[Deployment], contact_plan: str | None
) -> tuple[OrbiterSettings, Sequence[RelaySettings]]:
    """Return the settings of the orbiter, and of each rover's end; each rover has a key.

    Raises:
        SettingsError: an asset has no relay, or the orbiter does not know it.
    """
    path = config_folder() / "mops" / "orbiter.yaml"
    known = load_orbiter(path)
    behind = {rover.asset: rover for rover in known.rovers}
    orbiter_port, *ports = free_udp_ports(1 + len(rovers))
    served: list[RelayedRoverSettings] = []
    relays: list[RelaySettings] = []
    for rover, port in zip(rovers, ports, strict=True):
        asset = rover.settings.asset
        relay, _ = load_relay(asset)
        orbiter = replace(relay.orbiter, ltp=_at(orbiter_port), tcpcl=None, udp=None)
        if asset not in behind:
            raise SettingsError(f"{path}: {asset} is not among the rovers")
        relays.append(
            replace(
                relay,
                orbiter=orbiter,
                listen=_listen(port),
                contact_plan=contact_plan,
                health_interval_s=HEALTH_INTERVAL_S,
                security=_security(behind[asset]),
            )
        )
        usual = rover.address.port != ANY_PORT and is_free(behind[asset].port)
        mrs_port = behind[asset].port if usual else ANY_PORT
        served.append(replace(behind[asset], ltp=_at(port), tcpcl=None, udp=None, port=mrs_port))
    settings = replace(
        known,
        listen=_listen(orbiter_port),
        rovers=tuple(served),
        contact_plan=contact_plan,
        security=_security(*served),
        link_timeout_s=SILENT_AFTER_S,
        health_interval_s=HEALTH_INTERVAL_S,
    )
    return settings, relays


def _security(*rovers: RelayedRoverSettings) -> SecuritySettings:
    """Return the settings that sign all bundles from and to each of these with its key."""
    nodes = [(rover.asset, f"{rover.eid.rpartition('.')[0]}.*") for rover in rovers]
    return SecuritySettings(
        keys={asset: KeySettings(file=key_file_of(asset)) for asset, _ in nodes},
        policies=(
            *(PolicySettings(key=asset, source=node) for asset, node in nodes),
            *(PolicySettings(key=asset, destination=node) for asset, node in nodes),
        ),
    )


def key_file_of(asset: str) -> str:
    """Return the file name of an asset's key."""
    return f"{asset}.key"


def _at(port: int) -> LtpLink:
    return LtpLink(Address(HOST, port))


def _listen(port: int) -> Listen:
    return Listen(ltp=Address(HOST, port))


CONTACTS: Final = "contacts.ionrc"
RELAYS: Final = re.compile("^.* relays for ", re.MULTILINE)
"""Pattern of `rover-relay`'s output when it is up."""


class Orbiter(ProcessGroup):
    """The relay, with the rovers behind it.

    Attributes:
        start_utc_s: reference time of the outages.
        outages: times without contact.
        data: data folder of `rover-mops`.
        relays: the process `rover-relay` of each asset.
    """

    def __init__(
        self,
        start_utc_s: int,
        outages: Sequence[Outage],
        data: Path,
        orbiter: ChildProcess,
        relays: Mapping[str, ChildProcess],
        rovers: Sequence[Deployment],
    ) -> None:
        aboard = (child for rover in rovers for child in rover.children)
        super().__init__(*aboard, *relays.values(), orbiter)
        self.start_utc_s = start_utc_s
        self.outages = tuple(outages)
        self.data = data
        self.relays = relays
        self._orbiter = orbiter

    async def uri(self, asset: str) -> str:
        """Wait until the MRS of an asset behind the relay is served, and return its URI.

        Raises:
            ChildError: a process ended.
        """
        listens = re.compile(rf"^{re.escape(asset)} listens at (maltcp://\S+)", re.MULTILINE)
        return await self.wait_for_output(self._orbiter, listens)


@contextmanager
def run_relay(
    folder: Path,
    *rovers: Deployment,
    outages: Sequence[Outage] = (),
    restart: bool = False,
) -> Iterator[Orbiter]:
    """Yield the relay of rovers; at the end the orbiter ends before their relays.

    Its settings are those of `config/`, except for free ports. If a rover has a known port
    (`RoverAddress.port`), the orbiter serves its MRS at that of `config/`. Bundles are signed with
    a new key for each rover.

    Args:
        folder: receives settings, keys, contact plan, logs, and the orbiter's data. The data of a
            rover's end are in `Deployment.aboard`.
        rovers: deployments of different assets.
        outages: times without contact, in seconds after this start; without any, contact is
            continuous.
        restart: whether a `rover-relay` that ends by itself is restarted; else it is an error.

    Raises:
        SettingsError: an asset has no relay in `config/`.
    """
    start_utc_s = int(time.time())
    settings, relays = relay_settings(rovers, CONTACTS if outages else None)
    ends = [engine_of(rover.endpoint) for rover in settings.rovers]
    plan = plan_text(outages, start_utc_s, engine_of(parse_eid(settings.eid)), ends)
    (folder / CONTACTS).write_text(plan, encoding="utf-8")
    for rover in rovers:
        make_key(folder / key_file_of(rover.settings.asset))
    with ExitStack() as running:

        def start(
            name: str,
            module: str,
            settings: object,
            *arguments: str,
            domain: int,
            up: re.Pattern[str] | None = None,
        ) -> ChildProcess:
            path = folder / f"{name}.yaml"
            path.write_text(yaml.safe_dump(cattrs.unstructure(settings)), encoding="utf-8")
            options = ("--config", str(path), *arguments)
            child = ChildProcess(name, module, options, folder, {"ROS_DOMAIN_ID": str(domain)}, up)
            running.callback(child.end)
            return child

        children = {
            rover.settings.asset: start(
                f"relay-{rover.settings.asset}",
                "adapters.relay.rover.process",
                relay,
                *("--asset", rover.settings.asset, "--data", str(rover.aboard)),
                domain=rover.address.domain,
                up=RELAYS if restart else None,
            )
            for rover, relay in zip(rovers, relays, strict=True)
        }
        data = folder / "orbiter"
        orbiter = start(
            "orbiter",
            "adapters.relay.orbiter.process",
            settings,
            *("--data", str(data)),
            domain=rovers[0].address.domain,
        )
        yield Orbiter(start_utc_s, outages, data, orbiter, children, rovers)
