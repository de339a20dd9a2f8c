"""Starts the executive, and the simulation where no rover is, on a full ROS 2 installation.

The wheels have no launch; there `rover-sim` and `rover-executive` are started by hand.

    ros2 launch rover_executive rover.launch.py simulated:=true
    ros2 launch rover_executive rover.launch.py certificate:=a.pem key:=a.key authorities:=b.pem
"""

from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchContext, LaunchDescription

PACKAGE = "rover_executive"
OPTIONS = {
    "asset": ("jackal", "Asset name, or its YAML file."),
    "host": ("127.0.0.1", "Address of the MRS."),
    "port": ("21000", "Port of the MRS."),
    "certificate": ("", "TLS: PEM file of the rover's certificate; with key and authorities."),
    "key": ("", "TLS: PEM file of its private key."),
    "authorities": ("", "TLS: PEM file of the authorities by which the ground is believed."),
}
"""Options of rover-executive by name; one that is empty is left out."""


def generate_launch_description() -> LaunchDescription:
    """Return what to start."""
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=default, description=meaning)
                for name, (default, meaning) in OPTIONS.items()
            ),
            DeclareLaunchArgument(
                "simulated", default_value="false", description="Start a simulation too."
            ),
            DeclareLaunchArgument("world", default_value="rough", description="Where it drives."),
            Node(
                package=PACKAGE,
                executable="rover-sim",
                arguments=[
                    *("--asset", LaunchConfiguration("asset")),
                    *("--world", LaunchConfiguration("world")),
                ],
                condition=IfCondition(LaunchConfiguration("simulated")),
                output="screen",
            ),
            OpaqueFunction(function=executive),
        ]
    )


def executive(context: LaunchContext) -> list[Node]:
    """Return the executive, with the options that were given."""
    given = {name: LaunchConfiguration(name).perform(context) for name in OPTIONS}
    arguments = [word for name, text in given.items() if text for word in (f"--{name}", text)]
    return [
        Node(package=PACKAGE, executable="rover-executive", arguments=arguments, output="screen")
    ]
