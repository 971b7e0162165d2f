"""A folder for ROS 2 users: launch file, layouts of RViz and Foxglove, nodes in Python and C++.

The topics are those that `uuvsim serve SYSTEM --ros2` publishes. The folder names no path.
"""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from pathlib import Path
from string import Template
from typing import Any

from uuvsim_cosim.bridge.ros2.facts import facts_of
from uuvsim_cosim.bridge.ros2.robot import Robot, robots_of
from uuvsim_cosim.bridge.ros2.topics import Topic, topics_of, topics_text, variables_of
from uuvsim_cosim.commands.editor.ros2_templates import (
    CMAKE,
    CPP_NODE,
    CPP_PACKAGE,
    LAUNCH,
    PYTHON_NODE,
    PYTHON_PACKAGE,
    README,
    REPORT,
    SETUP,
    SETUP_CFG,
)
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.plan.plan import Plan

__all__ = ["ros2_workspace_files", "write_ros2_workspace"]

PYTHON, CPP = "uuvsim_example_py", "uuvsim_example_cpp"
CLOUD, SCAN, IMAGE = (f"sensor_msgs/msg/{name}" for name in ("PointCloud2", "LaserScan", "Image"))
ODOMETRY = "nav_msgs/msg/Odometry"
# Displays of RViz by the type of a topic.
_DISPLAYS: dict[str, tuple[str, dict[str, Any]]] = {
    ODOMETRY: ("Odometry", {"Shape": {"Value": "Axes", "Axes Length": 0.5}, "Keep": 1}),
    CLOUD: ("PointCloud2", {"Color Transformer": "AxisColor", "Axis": "Z", "Size (Pixels)": 3}),
    SCAN: ("LaserScan", {"Size (Pixels)": 3}),
    IMAGE: ("Image", {}),
    "geometry_msgs/msg/PoseStamped": ("Pose", {"Shape": "Axes"}),
}


def write_ros2_workspace(folder: Path, system: str, plan: Plan) -> list[Path]:
    """Write the files; raises InputInvalid, and writes nothing, if one of them exists already."""
    files = ros2_workspace_files(system, plan)
    if existing := [name for name in files if (folder / name).exists()]:
        raise InputInvalid(
            folder, f"{', '.join(existing)} exist already", "a folder without these files"
        )
    try:
        for name, text in files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(text, encoding="utf-8", newline="\n")
        (folder / "report.sh").chmod(0o755)
    except OSError as error:
        raise InputInvalid(f"{folder}: cannot be written ({error.strerror})") from None
    return [folder / name for name in files]


def ros2_workspace_files(system: str, plan: Plan) -> dict[str, str]:
    """Return the text of each file by its name; raises InputInvalid without an odometry."""
    facts = facts_of(plan)
    topics, robots = topics_of(variables_of(plan), facts), robots_of(plan, facts)
    odometry = next((t for t in topics if t.type == ODOMETRY and "q" in t.signals), None)
    if odometry is None:
        raise InputInvalid(f"--for {system}", f"no topic of {ODOMETRY}", "a system with a hull")
    words = {
        "system": system, "odometry": odometry.name, "frame": odometry.child,
        "python": PYTHON, "cpp": CPP,
        "topics": "\n".join(f"| `{name}` | `{type_}` |" for name, type_ in _listed(topics, robots)),
        "sample": next((t.name for t in topics if t.type.endswith("/Imu")), odometry.name),
    }  # fmt: skip
    has_fins = any(part.kind == "fin" for robot in robots for part in robot.parts)
    own, other = f"src/{PYTHON}", f"src/{CPP}"
    made = {
        "README.md": README,
        "report.sh": REPORT,
        f"{own}/package.xml": PYTHON_PACKAGE,
        f"{own}/setup.py": SETUP,
        f"{own}/setup.cfg": SETUP_CFG,
        f"{own}/{PYTHON}/depth.py": PYTHON_NODE,
        f"{own}/launch/view.launch.py": LAUNCH,
        f"{other}/package.xml": CPP_PACKAGE,
        f"{other}/CMakeLists.txt": CMAKE,
        f"{other}/src/depth.cpp": CPP_NODE,
    }
    return {
        **{name: Template(text).substitute(words) for name, text in made.items()},
        f"{own}/{PYTHON}/__init__.py": "",
        f"{own}/resource/{PYTHON}": "",
        f"{own}/rviz/view.rviz": _rviz(topics, robots, odometry),
        f"{own}/urdf/fins.urdf": robots[0].urdf if has_fins else "",
        "topics.yaml": topics_text(topics),
        "foxglove.json": json.dumps(_foxglove(topics, robots, odometry), indent=2) + "\n",
    }


def _listed(topics: Sequence[Topic], robots: Sequence[Robot]) -> list[tuple[str, str]]:
    """Return names and types of all topics, those of the node itself first."""
    own = [("/clock", "rosgraph_msgs/msg/Clock"), ("/tf_static", "tf2_msgs/msg/TFMessage")]
    own += [(robot.topic, "std_msgs/msg/String") for robot in robots]
    return [*own, *dict.fromkeys((t.name, t.type) for t in topics)]


def _rviz(topics: Sequence[Topic], robots: Sequence[Robot], odometry: Topic) -> str:
    """Return a configuration of RViz: the vehicles, their frames, and what sensors see."""
    from ruamel.yaml import YAML

    def display(kind: str, name: str, more: dict[str, Any]) -> dict[str, Any]:
        return {"Class": f"rviz_default_plugins/{kind}", "Name": name, "Enabled": True, **more}

    shown = [display("Grid", "Grid", {"Reference Frame": "map", "Cell Size": 5, "Alpha": 0.5}),
             display("TF", "TF", {"Frame Timeout": 15, "Marker Scale": 0.5})]  # fmt: skip
    shown += [
        display("RobotModel", robot.topic, {
            "Description Source": "Topic",
            "Description Topic": {"Value": robot.topic, "Durability Policy": "Transient Local",
                                  "Reliability Policy": "Reliable"},
        })
        for robot in robots
    ]  # fmt: skip
    for topic in topics:
        if topic.type in _DISPLAYS:
            kind, more = _DISPLAYS[topic.type]
            on = {"Value": topic.name, "Reliability Policy": "Reliable"}
            shown.append(display(kind, topic.name, {"Topic": on, **more}))
    view = {
        "Class": "rviz_default_plugins/Orbit",
        "Name": "Orbit",
        "Target Frame": odometry.child,
        "Distance": 8,
        "Yaw": 0.8,
        "Pitch": 0.4,
    }
    out = io.StringIO()
    yaml = YAML()
    yaml.default_flow_style = False
    yaml.dump(
        {
            "Panels": [
                {"Class": "rviz_common/Displays", "Name": "Displays"},
                {"Class": "rviz_common/Time", "Name": "Time"},
            ],
            "Visualization Manager": {
                "Class": "",
                "Displays": shown,
                "Global Options": {"Fixed Frame": "map", "Frame Rate": 30},
                "Tools": [{"Class": "rviz_default_plugins/MoveCamera"}],
                "Views": {"Current": view},
            },
        },
        out,
    )
    return out.getvalue()


def _foxglove(
    topics: Sequence[Topic], robots: Sequence[Robot], odometry: Topic
) -> dict[str, Any]:  # fmt: skip
    """Return a layout of Foxglove: a 3-D view beside plots of the depth and the speed."""
    seen = {t.name: {"visible": True} for t in topics if t.type in (CLOUD, SCAN)}
    models = {
        f"urdf-{i}": {
            "layerId": "foxglove.Urdf", "instanceId": f"urdf-{i}", "sourceType": "topic",
            "topic": robot.topic, "visible": True, "order": i,
        }
        for i, robot in enumerate(robots, 1)
    }  # fmt: skip
    estimated = [t.name for t in topics if t.type == ODOMETRY and t.child == odometry.child]

    def plot(title: str, path: str) -> dict[str, Any]:
        paths = [
            {"value": f"{name}.{path}", "enabled": True, "timestampMethod": "receiveTime"}
            for name in estimated
        ]
        return {"title": title, "paths": paths, "showLegend": True, "isSynced": True}

    panels: dict[str, Any] = {
        "3D!vehicle": {"followTf": odometry.child, "topics": seen, "layers": models},
        "Plot!depth": plot("Height [m], 0 at the surface", "pose.pose.position.z"),
        "Plot!speed": plot("Speed ahead [m/s]", "twist.twist.linear.x"),
    }
    images = [t.name for t in topics if t.type == IMAGE]
    plots: Any = {"direction": "column", "first": "Plot!depth", "second": "Plot!speed"}
    if images:
        panels["Image!camera"] = {"imageMode": {"imageTopic": images[0]}}
        plots = {"direction": "column", "first": "Image!camera", "second": plots}
    return {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {"direction": "row", "first": "3D!vehicle", "second": plots,
                   "splitPercentage": 65},
    }  # fmt: skip
