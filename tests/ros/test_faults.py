"""Faults of a simulation that runs: what begins and ends there, and what is refused."""

from collections.abc import Iterator
from math import degrees, radians

import pytest
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParametersAtomically
from sensor_msgs.msg import BatteryState, CompressedImage

from adapters.ros import conversions
from executive.settings import config_folder
from sim.ros.faults import SERVICE, FaultClient, fault_client
from sim.rover import faults
from tests.support.probe import LIMIT_S, Probe, probing
from tests.support.processes import simulation

pytestmark = pytest.mark.ros


@pytest.fixture(scope="module")
def probe(module_ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Probe]:
    """Give a probe beside a simulation on flat ground."""
    assert module_ros_domain > 0
    folder = tmp_path_factory.mktemp("sim")
    with simulation(folder, "--world", "flat", "--camera", "rays"), probing() as probe:
        yield probe


@pytest.fixture
def client(probe: Probe) -> Iterator[FaultClient]:
    """Give what tells that simulation its faults."""
    probe.fresh_truth()
    parameters = config_folder() / "jackal.ros.yaml"
    with fault_client("jackal", None, parameters, LIMIT_S) as client:
        yield client


def test_an_injected_fault_lasts_until_it_is_cleared(probe: Probe, client: FaultClient) -> None:
    client.inject(faults.Pushed(-0.75))
    assert probe.fresh_truth().pose.pose.position.y == pytest.approx(-0.75, abs=0.05)
    client.inject(faults.Tip(radians(120)))
    probe.until(lambda: abs(degrees(roll_rad(probe))) > 150, "it lies on its back")
    client.clear(faults.Tip)
    probe.until(lambda: abs(degrees(roll_rad(probe))) < 5, "it stands on its wheels")


def roll_rad(probe: Probe) -> float:
    return conversions.odometry_fact(probe.fresh_truth()).pose.roll_rad


def test_odometry_and_battery_on_ros_are_faulty_too(probe: Probe, client: FaultClient) -> None:
    odometry: list[Odometry] = []
    batteries: list[BatteryState] = []
    probe.receive(probe.topics.odometry, odometry.append)
    probe.receive(probe.topics.battery, batteries.append)
    probe.until(lambda: bool(odometry and batteries), "odometry and battery")
    client.inject(faults.OdometryRepeated())
    client.inject(faults.BatteryLow())
    odometry.clear()
    probe.until(lambda: len(odometry) > 20, "odometry")
    stamps = {(each.header.stamp.sec, each.header.stamp.nanosec) for each in odometry[10:]}
    assert len(stamps) == 1
    probe.until(lambda: batteries[-1].voltage == 21.5, "a low battery")
    client.clear(faults.OdometryRepeated)
    client.clear(faults.BatteryLow)
    probe.until(lambda: batteries[-1].voltage > 24, "a full battery")


def test_pictures_on_ros_are_faulty_too(probe: Probe, client: FaultClient) -> None:
    pictures: list[CompressedImage] = []
    probe.receive(probe.topics.camera, pictures.append)
    probe.until(lambda: len(pictures) > 1, "pictures")
    client.inject(faults.CameraTruncated())
    probe.until(lambda: len(pictures[-1].data) == 200, "a picture that is cut")
    client.clear(faults.CameraTruncated)
    client.inject(faults.CameraStale())
    pictures.clear()
    probe.until(lambda: len(pictures) > 3, "pictures")
    assert pictures[-1].header.stamp == pictures[-2].header.stamp
    client.clear(faults.CameraStale)
    seen = pictures[-1].header.stamp
    probe.until(lambda: pictures[-1].header.stamp != seen, "a new picture")


def test_a_fault_that_the_rover_cannot_have_is_refused(client: FaultClient) -> None:
    for fault in (faults.LaserDead(), faults.LinkLost()):
        with pytest.raises(ValueError, match=r"needs a (Jackal with .*laser|link .* not)"):
            client.inject(fault)
    client.clear(faults.ImuDead)


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        (
            "low_frictionn",
            ParameterValue(type=ParameterType.PARAMETER_BOOL),
            "did you mean low_friction",
        ),
        (
            "low_friction",
            ParameterValue(type=ParameterType.PARAMETER_DOUBLE),
            "expected a text, true or",
        ),
        (
            "low_friction",
            ParameterValue(type=ParameterType.PARAMETER_STRING, string_value="{factor: 7}"),
            "low_friction.factor: 7 is not in",
        ),
        (
            "low_friction",
            ParameterValue(type=ParameterType.PARAMETER_STRING, string_value="{factor: "),
            "while parsing",
        ),
    ],
)
def test_a_request_is_done_whole_or_not_at_all(
    probe: Probe, name: str, value: ParameterValue, text: str
) -> None:
    client = probe.node.create_client(SetParametersAtomically, SERVICE)
    probe.until(client.service_is_ready, "the service")
    push = ParameterValue(type=ParameterType.PARAMETER_BOOL, bool_value=True)
    before = probe.fresh_truth().pose.pose.position.y
    request = SetParametersAtomically.Request(
        parameters=[Parameter(name="pushed", value=push), Parameter(name=name, value=value)]
    )
    answer = client.call_async(request)
    probe.until(answer.done, "an answer")
    result = answer.result().result  # type: ignore[no-untyped-call]
    assert not result.successful
    assert text in result.reason
    assert probe.fresh_truth().pose.pose.position.y == pytest.approx(before, abs=0.02)


@pytest.mark.usefixtures("ros_domain")
def test_without_a_simulation_it_is_reported() -> None:
    parameters = config_folder() / "jackal.ros.yaml"
    with (
        pytest.raises(TimeoutError, match=r"no simulation of jackal .* rover-sim starts one"),
        fault_client("jackal", None, parameters, 0.1),
    ):
        pytest.fail("there is one")
