"""Starts the executive, and the simulation where no rover is, on a full ROS 2 installation.

The wheels have no launch; there `rover-sim` and `rover-executive` are started by hand.

    ros2 launch rover_executive rover.launch.py simulated:=true
"""

from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription

PACKAGE = "rover_executive"


def generate_launch_description() -> LaunchDescription:
    """Return what to start."""
    asset = LaunchConfiguration("asset")
    return LaunchDescription(
        [
            DeclareLaunchArgument("asset", default_value="jackal", description="Asset name."),
            DeclareLaunchArgument(
                "simulated", default_value="false", description="Start a simulation too."
            ),
            DeclareLaunchArgument("world", default_value="rough", description="Where it drives."),
            DeclareLaunchArgument("port", default_value="41000", description="Port of the MRS."),
            Node(
                package=PACKAGE,
                executable="rover-sim",
                arguments=["--asset", asset, "--world", LaunchConfiguration("world")],
                condition=IfCondition(LaunchConfiguration("simulated")),
                output="screen",
            ),
            Node(
                package=PACKAGE,
                executable="rover-executive",
                arguments=["--asset", asset, "--port", LaunchConfiguration("port")],
                output="screen",
            ),
        ]
    )
