"""The folder for ROS 2 users: its topics are those that the node publishes; its files are valid."""

from __future__ import annotations

import ast
import configparser
import json
import re
import subprocess
import sys
import types
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

import uuvsim_cosim as uuv
from tests.conftest import Uuvsim
from uuvsim_cosim.bridge.ros2.node import Ros2Node
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.commands.editor.ros2_workspace import ros2_workspace_files, write_ros2_workspace
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.running.library import load
from uuvsim_cosim.orchestrator.shipped.of_vehicle import system_of

SYSTEM = "seabed_mapping"
PYTHON, CPP = "src/uuvsim_example_py", "src/uuvsim_example_cpp"
DISPLAYS = {
    "Odometry": "nav_msgs/msg/Odometry", "PointCloud2": "sensor_msgs/msg/PointCloud2",
    "LaserScan": "sensor_msgs/msg/LaserScan", "Image": "sensor_msgs/msg/Image",
    "Pose": "geometry_msgs/msg/PoseStamped",
}  # fmt: skip
# Stand-ins for the headers of rclcpp and nav_msgs: what the node uses of them.
STUBS = {
    "nav_msgs/msg/odometry.hpp": """
#include <string>
namespace nav_msgs { namespace msg { struct Odometry {
  struct { struct { int sec; unsigned nanosec; } stamp; std::string frame_id; } header;
  struct { struct { struct { double x, y, z; } position;
                    struct { double x, y, z, w; } orientation; } pose; } pose;
}; } }
""",
    "rclcpp/rclcpp.hpp": """
#include <functional>
#include <memory>
#include <string>
#include <vector>
namespace rclcpp {
struct Parameter { Parameter(const std::string &, bool) {} };
struct NodeOptions { NodeOptions & parameter_overrides(const std::vector<Parameter> &); };
template <class M> struct Subscription { using SharedPtr = std::shared_ptr<Subscription<M>>; };
struct Logger {};
struct Node {
  Node(const std::string &, const NodeOptions &) {}
  Logger get_logger() const;
  template <class M, class F>
  typename Subscription<M>::SharedPtr create_subscription(const std::string &, int, F && f) {
    M message{}; f(message); return nullptr;
  }
};
void init(int, char **); void spin(std::shared_ptr<Node>); void shutdown();
int print(const Logger &, const char *, ...) __attribute__((format(printf, 2, 3)));
}
#define RCLCPP_INFO(...) ::rclcpp::print(__VA_ARGS__)
""",
}


@pytest.fixture(scope="module")
def live() -> dict[str, str]:
    with Conductor(SYSTEM) as conductor, Ros2Node(conductor, port=0) as node:
        types_ = {topic.name: topic.type for topic in node.topics}
    return types_ | {
        "/clock": "rosgraph_msgs/msg/Clock", "/tf_static": "tf2_msgs/msg/TFMessage",
        "/robot_description": "std_msgs/msg/String",
    }  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("ros2") / "ws"
    write_ros2_workspace(made, SYSTEM, flatten(load(SYSTEM)))
    return made


def test_the_listed_topics_are_those_of_the_running_node(
    folder: Path, live: dict[str, str]
) -> None:
    text = (folder / "README.md").read_text()
    assert dict(re.findall(r"^\| `(/\S+)` \| `(\S+)` \|$", text, re.M)) == live


def test_displays_of_rviz_have_topics_of_their_type(folder: Path, live: dict[str, str]) -> None:
    rviz = YAML(typ="safe").load((folder / PYTHON / "rviz/view.rviz").read_text())
    displays = rviz["Visualization Manager"]["Displays"]
    kinds = {d["Class"].removeprefix("rviz_default_plugins/"): d for d in displays}
    assert kinds.keys() == {"Grid", "TF", "RobotModel", *DISPLAYS}
    for display in displays:
        kind = display["Class"].removeprefix("rviz_default_plugins/")
        if kind in DISPLAYS:
            assert live[display["Topic"]["Value"]] == DISPLAYS[kind]
    described = kinds["RobotModel"]["Description Topic"]
    assert live[described["Value"]] == "std_msgs/msg/String"
    assert described["Durability Policy"] == "Transient Local"


def test_the_layout_of_foxglove_has_topics_of_the_node(folder: Path, live: dict[str, str]) -> None:
    layout = json.loads((folder / "foxglove.json").read_text())
    panels = layout["configById"]
    shown = set(panels["3D!vehicle"]["topics"])
    assert {live[name] for name in shown} == {DISPLAYS["PointCloud2"], DISPLAYS["LaserScan"]}
    for panel in ("Plot!depth", "Plot!speed"):
        for path in panels[panel]["paths"]:
            assert live[path["value"].partition(".")[0]] == DISPLAYS["Odometry"]
    assert live[panels["Image!camera"]["imageMode"]["imageTopic"]] == DISPLAYS["Image"]
    for layer in panels["3D!vehicle"]["layers"].values():
        assert live[layer["topic"]] == "std_msgs/msg/String"

    def leaves(node: Any) -> list[str]:
        return [node] if isinstance(node, str) else leaves(node["first"]) + leaves(node["second"])

    assert sorted(leaves(layout["layout"])) == sorted(panels)


def test_python_files_compile_and_packages_are_xml_of_format_3(folder: Path) -> None:
    for file in (folder / PYTHON).rglob("*.py"):
        ast.parse(file.read_text(), str(file))
    for package, kind in ((PYTHON, "ament_python"), (CPP, "ament_cmake")):
        root = ET.parse(folder / package / "package.xml").getroot()
        assert (root.get("format"), root.findtext("name")) == ("3", Path(package).name)
        assert root.findtext("export/build_type") == kind
    scripts = configparser.ConfigParser()
    scripts.read(folder / PYTHON / "setup.cfg")
    assert scripts["install"]["install_scripts"] == "$base/lib/uuvsim_example_py"


def test_files_that_setup_installs_are_there(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    given: dict[str, Any] = {}
    stand_in = types.ModuleType("setuptools")
    stand_in.setup = lambda **options: given.update(options)  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "setuptools", stand_in)
    monkeypatch.chdir(folder / PYTHON)
    exec(compile(Path("setup.py").read_text(), "setup.py", "exec"), {})
    for _, files in given["data_files"]:
        assert files
        assert all(Path(file).is_file() for file in files)
    assert given["entry_points"]["console_scripts"] == ["depth = uuvsim_example_py.depth:main"]
    assert Path("uuvsim_example_py/depth.py").is_file()


def test_the_python_node_prints_depth_and_heading_once_per_second(
    folder: Path, live: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    lines: list[str] = []
    subscribed: list[str] = []

    class Node:
        def __init__(self, name: str, parameter_overrides: list[object]) -> None:
            assert parameter_overrides == [("use_sim_time", 1, True)]

        def create_subscription(self, kind: object, topic: str, call: object, depth: int) -> None:
            subscribed.append(topic)

        def get_logger(self) -> Any:
            return types.SimpleNamespace(info=lines.append)

    class Parameter(tuple):
        Type = types.SimpleNamespace(BOOL=1)

        def __new__(cls, *values: object) -> Any:
            return tuple.__new__(cls, values)

    for name, content in {
        "rclpy": {}, "rclpy.node": {"Node": Node}, "rclpy.parameter": {"Parameter": Parameter},
        "nav_msgs": {}, "nav_msgs.msg": {"Odometry": object},
    }.items():  # fmt: skip
        module = types.ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
    scope: dict[str, Any] = {"__name__": "depth"}
    text = (folder / PYTHON / "uuvsim_example_py/depth.py").read_text()
    exec(compile(text, "depth.py", "exec"), scope)
    node = scope["Depth"]()
    assert live[subscribed[0]] == DISPLAYS["Odometry"]
    of = types.SimpleNamespace
    for time in (0.0, 0.5, 1.0, 1.5):
        node.on_odometry(of(
            header=of(stamp=of(sec=int(time), nanosec=int(time % 1 * 1e9))),
            pose=of(pose=of(position=of(z=-5.0), orientation=of(x=0.0, y=0.0, z=0.0, w=1.0))),
        ))  # fmt: skip
    assert lines == [  # a yaw of 0 in ENU is a heading of 90°
        "t 0.0 s  depth 5.00 m  heading 90 deg", "t 1.0 s  depth 5.00 m  heading 90 deg",
    ]  # fmt: skip


def test_the_cpp_node_compiles_with_stand_ins_of_the_headers(folder: Path, tmp_path: Path) -> None:
    for name, text in STUBS.items():
        (tmp_path / "include" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "include" / name).write_text(text)
    done = subprocess.run(
        [sys.executable, "-m", "ziglang", "c++", "-std=c++17", "-Wall", "-Wextra", "-Werror",
         "-c", "-o", str(tmp_path / "depth.o"), "-I", str(tmp_path / "include"),
         str(folder / CPP / "src/depth.cpp")],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    cmake = (folder / CPP / "CMakeLists.txt").read_text()
    assert "add_executable(depth src/depth.cpp)" in cmake
    assert "lib/${PROJECT_NAME}" in cmake


def test_the_report_is_a_script_of_ten_lines(folder: Path, live: dict[str, str]) -> None:
    script = folder / "report.sh"
    assert len(script.read_text().splitlines()) == 10
    assert script.stat().st_mode & 0o100
    assert subprocess.run(["bash", "-n", script], check=False).returncode == 0
    asked = re.findall(r" (/\S+)", script.read_text().partition("\n")[2])
    assert asked
    assert set(asked) <= live.keys()


def test_only_a_vehicle_with_fins_has_a_description_for_them(folder: Path) -> None:
    assert (folder / PYTHON / "urdf/fins.urdf").read_text() == ""
    files = ros2_workspace_files("remus", flatten(system_of("remus100", "hold")))
    assert 'name="fins_4"' in files[f"{PYTHON}/urdf/fins.urdf"]


def test_the_command_writes_the_folder_once(tmp_path: Path, uuvsim: Uuvsim) -> None:
    target = str(tmp_path / "ws")
    status, out, _ = uuvsim("new", "--ros2-workspace", target, "--for", "bluerov2_hold")
    assert status == 0
    assert "uuvsim serve bluerov2_hold --ros2 jazzy" in out
    status, _, err = uuvsim("new", "--ros2-workspace", target, "--for", "bluerov2_hold")
    assert status == 2
    assert "README.md, report.sh" in err
    assert "exist already" in err


@pytest.mark.parametrize("more", [["controller"], ["--as", "c"], ["--workspace", "x"]])
def test_other_options_beside_it_are_refused(
    tmp_path: Path, uuvsim: Uuvsim, more: list[str]
) -> None:
    status, _, err = uuvsim("new", "--ros2-workspace", str(tmp_path / "w"), *more)
    assert (status, "expected --for SYSTEM alone beside it" in err) == (2, True)


def test_a_system_without_a_hull_is_refused() -> None:
    plan = flatten(uuv.System("s", "0.1").add("leak", "model:leak"))
    with pytest.raises(InputInvalid, match=r"--for s: no topic of nav_msgs/msg/Odometry"):
        ros2_workspace_files("s", plan)
