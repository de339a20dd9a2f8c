"""The command `rover inject`: a sub-command for each fault that a simulated rover can have."""

from math import degrees
from typing import Any, Final

import click

from adapters.process import asset_option
from executive.commands import Argument
from sim.rover.faults import (
    FaultTarget,
    Side,
    SimulatedFaultDeclaration,
    Value,
    bounds,
    declared_faults,
)

DISCOVERY_S: Final = 10.0


@click.group()
def inject() -> None:
    """Inject a fault into a running simulation, or clear it.

    The simulation is that of `rover-sim`, in the ROS domain of ROS_DOMAIN_ID; `rover demo --stay`
    starts one, too.

    \b
    Examples:
      rover inject odometry_frozen
      rover inject odometry_frozen --clear
      rover inject low_friction --factor 0.2
      rover inject tip --by 40deg
      rover inject left_wheels_stuck --asset mocup

    \b
    Exit status: 0 done, 1 this rover cannot have it, 2 invalid arguments, 3 no simulation answers.
    """


def _command(declaration: SimulatedFaultDeclaration) -> click.Command:
    """Return the sub-command that injects or clears a fault."""

    @asset_option()
    @click.option("--clear", is_flag=True, help="Clear the fault.")
    def begin_or_end(asset: str, clear: bool, **given: str | bool | None) -> None:
        texts = {name: text for name, text in given.items() if text is not None}
        if clear and texts:
            raise click.UsageError(f"--clear ends the fault: leave --{next(iter(texts))} out")
        try:
            fault = declaration.make({name: _plain(text) for name, text in texts.items()})
        except ValueError as error:
            raise click.UsageError(str(error)) from error
        _inject(declaration, asset, None if clear else fault)

    begin_or_end.__doc__ = _help(declaration)
    for parameter in reversed(declaration.parameters):
        begin_or_end = _option(declaration, parameter)(begin_or_end)
    return click.command(declaration.name)(begin_or_end)


def _inject(declaration: SimulatedFaultDeclaration, asset: str, fault: Any) -> None:
    """Send the request to the simulation, and print the result."""
    from executive.settings import SettingsError, config_folder, load_settings
    from sim.ros.faults import fault_client

    try:
        name = load_settings(asset).asset
    except SettingsError as error:
        raise click.UsageError(str(error)) from error
    parameters = config_folder() / f"{name}.ros.yaml"
    with fault_client(name, None, parameters, DISCOVERY_S) as client:
        try:
            if fault is None:
                client.clear(declaration.kind)
            else:
                client.inject(fault)
        except ValueError as error:
            raise click.ClickException(str(error)) from error
    click.echo(f"{name}: {declaration.name} {'cleared' if fault is None else 'injected'}")


def _plain(text: str | bool) -> object:
    """Return a number if a text is one."""
    if isinstance(text, bool):
        return text
    try:
        return float(text)
    except ValueError:
        return text


def _option(declaration: SimulatedFaultDeclaration, parameter: Argument) -> Any:
    default = declaration.default(parameter)
    if isinstance(default, bool):
        return click.option(
            f"--{parameter.name}", is_flag=True, default=None, help=f"Whether {parameter.help}."
        )
    if isinstance(default, Side):
        sides = [side.value for side in Side]
        return click.option(
            f"--{parameter.name}",
            type=click.Choice(sides),
            help=f"Which wheels.  [default: {default.value}]",
        )
    low, high = (_shown(bound, parameter) for bound in bounds(parameter))
    unit = "" if parameter.unit.startswith("rad") else parameter.unit
    meant = ", ".join(filter(None, (f"{low} to {high} {unit}".strip(), parameter.help)))
    return click.option(
        f"--{parameter.name}",
        metavar={"rad": "ANGLE", "rad/s": "ANGLE/S"}.get(parameter.unit, "NUMBER"),
        help=f"{meant}.  [default: {_shown(default, parameter)}]",
    )


def _shown(value: Value, parameter: Argument) -> str:
    """Return a value as it can be typed."""
    if isinstance(value, Side):
        return value.value
    return f"{degrees(value):.3g}deg" if parameter.unit.startswith("rad") else f"{value:g}"


def _help(declaration: SimulatedFaultDeclaration) -> str:
    example = f"  rover inject {declaration.name}"
    lines = [example]
    for parameter in declaration.parameters[:1]:
        if parameter.kind is bool:
            lines.append(f"{example} --{parameter.name}")
            continue
        shown = _shown(declaration.default(parameter), parameter)
        lines.append(f"{example} --{parameter.name} {shown}")
    lines.append(f"{example} --clear")
    return "\n".join((declaration.summary, "", "\b", "Examples:", *lines))


for _each in declared_faults():
    if _each.needs is not FaultTarget.LINK:
        inject.add_command(_command(_each))
