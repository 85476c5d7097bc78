"""ros2 launch taxelflow_ros slip.launch.py sensor:=schunk-sdh2 topic:=/touch type:=tactile_msgs/msg/TactileState"""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription

ARGUMENTS = {
    "sensor": "barretthand-162",
    "topic": "/touch",
    "type": "tactile_msgs/msg/TactileState",
    "method": "convolution",
}


def generate_launch_description() -> LaunchDescription:
    """The node, with its arguments as parameters."""
    declared = [DeclareLaunchArgument(name, default_value=value) for name, value in ARGUMENTS.items()]
    given = {name: LaunchConfiguration(name) for name in ARGUMENTS}
    return LaunchDescription([*declared, Node(package="taxelflow_ros", executable="slip", parameters=[given])])
