"""Where a demonstration takes place: never where another rover is."""

import socket

import pytest

from sim.processes.rover_address import (
    AddressError,
    RoverAddress,
    allocate_address,
    default_address,
)
from tests.support.ports import free_port


def test_demonstrations_are_isolated() -> None:
    with allocate_address() as one, allocate_address() as other:
        assert one.domain != other.domain
        assert 1 <= one.domain <= 101


def test_rovers_beside_one_another_are_at_ports_of_their_own() -> None:
    known = RoverAddress(0, 21000, shared=False)
    assert [known.next_address(number).port for number in range(3)] == [21000, 21001, 21002]
    with allocate_address() as free:
        assert free.next_address(1) == free, "each executive takes any free port"


def test_a_second_demonstration_has_a_port_and_a_domain_of_its_own() -> None:
    port = free_port()
    with allocate_address(port) as address, allocate_address() as other:
        assert (address.port, address.shared) == (port, False)
        assert address.next_address(1).port == port + 1
        assert address.domain != other.domain
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(AddressError, match="in use"), allocate_address(taken.getsockname()[1]):
            pass


def test_a_domain_is_released() -> None:
    with allocate_address() as first:
        pass
    with allocate_address() as again:
        assert again.domain == first.domain


def test_a_domain_with_a_participant_is_not_free() -> None:
    with allocate_address() as first:
        pass
    with socket.socket(type=socket.SOCK_DGRAM) as participant:
        participant.bind(("", 7400 + 250 * first.domain))
        with allocate_address() as other:
            assert other.domain != first.domain


def test_a_taken_port_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        monkeypatch.setenv("ROVER_URI", f"localhost:{port}")
        with pytest.raises(AddressError, match=f"port {port} of 127.0.0.1 is in use"):
            default_address()


def test_the_known_address_is_the_default_of_commands(monkeypatch: pytest.MonkeyPatch) -> None:
    port = free_port()
    monkeypatch.setenv("ROVER_URI", f"maltcp://127.0.0.1:{port}/MRS")
    with allocate_address() as unused:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(unused.domain))
        address = default_address()
    assert (address.domain, address.port, address.shared) == (unused.domain, port, False)


@pytest.mark.parametrize(
    ("variable", "value", "message"),
    [
        ("ROS_DOMAIN_ID", "233", "0 to 232"),
        ("ROS_DOMAIN_ID", "mars", "0 to 232"),
        ("ROVER_URI", "rover.example:21000", "Unset ROVER_URI"),
        ("ROVER_URI", "maltcp://nowhere", "ROVER_URI"),
    ],
)
def test_an_invalid_setting_is_named(
    monkeypatch: pytest.MonkeyPatch, variable: str, value: str, message: str
) -> None:
    monkeypatch.setenv(variable, value)
    with pytest.raises(AddressError, match=message):
        default_address()
