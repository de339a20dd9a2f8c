"""The ROS service that injects and clears faults of a simulated rover: its server and its client.

Its type is one that every ROS has: each parameter of a request is named like a fault. A text has
the fault's own parameters in YAML, `{by: 0.5}`; true injects it with its defaults, false clears it.
A request is executed completely or not at all.
"""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import yaml
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue, SetParametersResult
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.executors import Executor
from rclpy.node import Node

from adapters.ros import ros_node, single_threaded
from executive.core.recording import RecordingSink
from executive.settings import parse_yaml
from sim.rover.body import SimulatedBody
from sim.rover.faults import (
    SimulatedFault,
    fault_declaration,
    format_fault,
    read_fault,
    read_kind,
    unsupported_reason,
)
from sim.rover.simulation import fault_changed

SERVICE: Final = "simulation/faults"
ANSWER_S: Final = 10.0
_LOG: Final = logging.getLogger(__name__)


def serve_faults(node: Node, rover: SimulatedBody, tape: RecordingSink) -> None:
    """Serve requests to inject and clear faults."""

    def on_request(request: Any, response: Any) -> Any:
        try:
            wanted = [_read(parameter, rover) for parameter in request.parameters]
        except ValueError as error:
            reason = " ".join(str(error).split())
            _LOG.warning("fault refused: %s", reason)
            response.result = SetParametersResult(successful=False, reason=reason)
            return response
        for fault in wanted:
            if isinstance(fault, SimulatedFault):
                rover.inject(fault)
                tape.put(fault_changed(rover.time_s, type(fault), fault))
                _LOG.warning("fault injected: %s", format_fault(fault))
            else:
                rover.clear(fault)
                tape.put(fault_changed(rover.time_s, fault, None))
                _LOG.warning("fault cleared: %s", fault_declaration(fault).name)
        response.result = SetParametersResult(successful=True)
        return response

    node.create_service(SetParametersAtomically, SERVICE, on_request)


def _read(parameter: Parameter, rover: SimulatedBody) -> SimulatedFault | type[SimulatedFault]:
    """Return the fault to inject, or the kind of the one to clear.

    Raises:
        ValueError: the fault is unknown, its parameters are no YAML, or this rover cannot
            have it.
    """
    kind = read_kind(parameter.name).kind
    value = parameter.value
    match value.type:
        case ParameterType.PARAMETER_BOOL:
            if not value.bool_value:
                return kind
            fault = read_fault(parameter.name)
        case ParameterType.PARAMETER_STRING:
            given = parse_yaml(value.string_value, parameter.name) or {}
            fault = read_fault({parameter.name: given})
        case _:
            raise ValueError(f"{parameter.name}: expected a text, true or false")
    why = unsupported_reason(kind, rover.parts)
    if why is not None:
        raise ValueError(why)
    return fault


class FaultClient:
    """Injects and clears faults of a simulation, and waits for the result.

    One thread at a time may call it.
    """

    def __init__(self, node: Node, executor: Executor) -> None:
        self._executor = executor
        self._client = node.create_client(SetParametersAtomically, SERVICE)

    def connect(self, limit_s: float) -> bool:
        """Wait for a simulation; return whether one was found."""
        return bool(self._client.wait_for_service(limit_s))

    def inject(self, fault: SimulatedFault) -> None:
        """Inject a fault.

        Raises:
            ValueError: the rover cannot have it; the text names the missing part.
            TimeoutError: the simulation does not answer.
        """
        ((name, given),) = format_fault(fault).items()
        text = yaml.safe_dump(given, default_flow_style=True)
        self._set(name, ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=text))

    def clear(self, kind: type[SimulatedFault]) -> None:
        """Clear a fault, if it is active.

        Raises:
            TimeoutError: the simulation does not answer.
        """
        value = ParameterValue(type=ParameterType.PARAMETER_BOOL, bool_value=False)
        self._set(fault_declaration(kind).name, value)

    def _set(self, name: str, value: ParameterValue) -> None:
        request = SetParametersAtomically.Request(parameters=[Parameter(name=name, value=value)])
        answer = self._client.call_async(request)
        self._executor.spin_until_future_complete(answer, ANSWER_S)
        if not answer.done():  # type: ignore[no-untyped-call]
            raise TimeoutError(f"the simulation did not answer within {ANSWER_S:g} s")
        response: Any = answer.result()  # type: ignore[no-untyped-call]
        if not response.result.successful:
            raise ValueError(response.result.reason)


@contextmanager
def fault_client(
    asset: str, domain: int | None, parameters: Path, limit_s: float
) -> Iterator[FaultClient]:
    """Yield a client of an asset's simulation; domain None selects ROS_DOMAIN_ID.

    Raises:
        TimeoutError: none is found within the limit.
    """
    with (
        ros_node("faults", asset, parameters=parameters, domain_id=domain) as node,
        single_threaded(node) as executor,
    ):
        client = FaultClient(node, executor)
        if not client.connect(limit_s):
            raise TimeoutError(
                f"no simulation of {asset} answers in ROS domain {node.context.get_domain_id()};"
                " rover-sim starts one, ROS_DOMAIN_ID and --asset choose another"
            )
        yield client
