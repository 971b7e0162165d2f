"""Texts of the files for ROS 2 users; ``$$`` is a dollar sign, ``$name`` a word of the system."""

from __future__ import annotations

__all__ = [
    "CMAKE",
    "CPP_NODE",
    "CPP_PACKAGE",
    "LAUNCH",
    "PYTHON_NODE",
    "PYTHON_PACKAGE",
    "README",
    "REPORT",
    "SETUP",
    "SETUP_CFG",
]

README = """\
# $system in ROS 2

The simulation publishes topics that every machine with `rmw_zenoh` sees. Start it first, in an
environment with `pip install 'uuvsim-cosim[ros]'`; that machine needs no ROS:

    uuvsim serve $system --ros2 jazzy

Then build the two packages on a machine with ROS 2, and start one of the nodes or the view:

    export RMW_IMPLEMENTATION=rmw_zenoh_cpp
    colcon build --symlink-install
    source install/setup.bash
    ros2 run $python depth
    ros2 run $cpp depth
    ros2 launch $python view.launch.py

Both nodes read `$odometry` and print depth and heading once per second of simulated time.

`topics.yaml` maps signals to topics, with types, frames, rates and QoS. Edit it, and serve the
system with `--topics topics.yaml`.

`foxglove.json` is a layout: import it in Foxglove, and open `foxglove_bridge` or a recording.

These files were checked without a ROS installation: the names and types of the topics against
those that the simulation publishes, the Python node by running it with stand-ins of ROS's packages,
and the C++ file by a compiler with such stand-ins. `colcon build`, the launch file, RViz and
Foxglove were not run. If something does not work, please send the output of `./report.sh` with your
report.

## Topics

| topic | type |
|---|---|
$topics
"""

REPORT = """\
#!/bin/bash
# Prints what this machine sees of the simulation. Please send the output with your report.
export RMW_IMPLEMENTATION=rmw_zenoh_cpp
echo "$${ROS_DISTRO:-no ROS}, domain $${ROS_DOMAIN_ID:-0}, $$(uname -srm)"
ros2 pkg list | grep -xE 'rmw_zenoh_cpp|rviz2|foxglove_bridge|marine_acoustic_msgs'
ros2 node list && ros2 topic list -t
ros2 topic info -v $sample
timeout 10 ros2 topic hz $sample
timeout 10 ros2 topic echo --once $odometry
timeout 10 ros2 topic echo --once --qos-durability transient_local /tf_static | head -20
"""

PYTHON_PACKAGE = """\
<?xml version="1.0"?>
<package format="3">
  <name>$python</name>
  <version>0.1.0</version>
  <description>Depth and heading of $system, and a view in RViz</description>
  <maintainer email="you@example.com">you</maintainer>
  <license>Apache-2.0</license>
  <exec_depend>rclpy</exec_depend>
  <exec_depend>nav_msgs</exec_depend>
  <exec_depend>launch_ros</exec_depend>
  <exec_depend>robot_state_publisher</exec_depend>
  <exec_depend>rviz2</exec_depend>
  <export>
    <build_type>ament_python</build_type>
  </export>
</package>
"""

SETUP = """\
from glob import glob

from setuptools import setup

setup(
    name="$python",
    version="0.1.0",
    packages=["$python"],
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/$python"]),
        ("share/$python", ["package.xml"]),
        ("share/$python/launch", glob("launch/*.py")),
        ("share/$python/rviz", glob("rviz/*.rviz")),
        ("share/$python/urdf", glob("urdf/*.urdf")),
    ],
    install_requires=["setuptools"],
    entry_points={"console_scripts": ["depth = $python.depth:main"]},
)
"""

SETUP_CFG = """\
[develop]
script_dir=$$base/lib/$python
[install]
install_scripts=$$base/lib/$python
"""

PYTHON_NODE = '''\
"""Prints depth and heading of the vehicle once per second of simulated time."""

import math

import rclpy
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.parameter import Parameter


class Depth(Node):
    """Subscriber of an odometry in ENU."""

    def __init__(self):
        super().__init__(
            "depth", parameter_overrides=[Parameter("use_sim_time", Parameter.Type.BOOL, True)]
        )
        self.printed = -1.0
        self.subscription = self.create_subscription(
            Odometry, "$odometry", self.on_odometry, 10
        )

    def on_odometry(self, message):
        time = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        if 0.0 <= time - self.printed < 1.0:
            return
        self.printed = time
        q = message.pose.pose.orientation
        yaw = math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z))
        heading = (90.0 - math.degrees(yaw)) % 360.0  # from north, clockwise
        depth = -message.pose.pose.position.z
        self.get_logger().info(f"t {time:.1f} s  depth {depth:.2f} m  heading {heading:.0f} deg")


def main():
    rclpy.init()
    node = Depth()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()


if __name__ == "__main__":
    main()
'''

LAUNCH = '''\
"""RViz and the node; with simulation:=true the simulation as well, on this machine."""

import os

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description():
    share = get_package_share_directory("$python")
    simulated = {"use_sim_time": True}
    with open(os.path.join(share, "urdf", "fins.urdf"), encoding="utf-8") as file:
        fins = file.read()  # empty if the vehicle has none; all other frames are in /tf_static
    joints = [
        Node(
            package="robot_state_publisher",
            executable="robot_state_publisher",
            parameters=[simulated, {"robot_description": fins}],
            remappings=[("robot_description", "fins/robot_description")],
        )
    ]
    return LaunchDescription(
        [
            DeclareLaunchArgument("simulation", default_value="false"),
            ExecuteProcess(
                cmd=["uuvsim", "serve", "$system", "--ros2", os.environ.get("ROS_DISTRO", "jazzy")],
                condition=IfCondition(LaunchConfiguration("simulation")),
                output="screen",
            ),
            Node(package="$python", executable="depth", output="screen"),
            Node(
                package="rviz2",
                executable="rviz2",
                arguments=["-d", os.path.join(share, "rviz", "view.rviz")],
                parameters=[simulated],
            ),
            *(joints if fins else []),
        ]
    )
'''

CPP_PACKAGE = """\
<?xml version="1.0"?>
<package format="3">
  <name>$cpp</name>
  <version>0.1.0</version>
  <description>Depth and heading of $system</description>
  <maintainer email="you@example.com">you</maintainer>
  <license>Apache-2.0</license>
  <buildtool_depend>ament_cmake</buildtool_depend>
  <depend>rclcpp</depend>
  <depend>nav_msgs</depend>
  <export>
    <build_type>ament_cmake</build_type>
  </export>
</package>
"""

CMAKE = """\
cmake_minimum_required(VERSION 3.16)
project($cpp)

find_package(ament_cmake REQUIRED)
find_package(rclcpp REQUIRED)
find_package(nav_msgs REQUIRED)

add_executable(depth src/depth.cpp)
target_compile_features(depth PUBLIC cxx_std_17)
target_link_libraries(depth PUBLIC rclcpp::rclcpp $${nav_msgs_TARGETS})
install(TARGETS depth DESTINATION lib/$${PROJECT_NAME})

ament_package()
"""

CPP_NODE = """\
// Prints depth and heading of the vehicle once per second of simulated time.

#include <cmath>
#include <memory>

#include "nav_msgs/msg/odometry.hpp"
#include "rclcpp/rclcpp.hpp"

class Depth : public rclcpp::Node {
 public:
  Depth()
      : Node("depth", rclcpp::NodeOptions().parameter_overrides(
                          {rclcpp::Parameter("use_sim_time", true)})) {
    subscription_ = create_subscription<nav_msgs::msg::Odometry>(
        "$odometry", 10,
        [this](const nav_msgs::msg::Odometry & message) { on_odometry(message); });
  }

 private:
  void on_odometry(const nav_msgs::msg::Odometry & message) {
    const double time = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec;
    if (time >= printed_ && time < printed_ + 1.0) {
      return;
    }
    printed_ = time;
    const auto & q = message.pose.pose.orientation;
    const double pi = std::acos(-1.0);
    const double yaw =
        std::atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z));
    const double heading = std::fmod(450.0 - yaw * 180.0 / pi, 360.0);  // from north, clockwise
    RCLCPP_INFO(get_logger(), "t %.1f s  depth %.2f m  heading %.0f deg", time,
                -message.pose.pose.position.z, heading);
  }

  double printed_ = -1.0;
  rclcpp::Subscription<nav_msgs::msg::Odometry>::SharedPtr subscription_;
};

int main(int argc, char ** argv) {
  rclcpp::init(argc, argv);
  rclcpp::spin(std::make_shared<Depth>());
  rclcpp::shutdown();
  return 0;
}
"""
