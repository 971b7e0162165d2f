"""Snippets of VS Code: a beginning of each file that users write, with places to fill in."""

from __future__ import annotations

__all__ = ["snippets"]

# By schema: what it begins, and its lines. ${1:...} are the places that the editor visits.
_YAML = {
    "study": (
        "A study: many runs over a grid and random draws",
        """\
system: ${1:bluerov2_hold}
duration: ${2:20 s}
every: ${3:0.05 s}
seeds: ${4:8}
parameters:
  ${5:hull.v_c[1]}: {grid: {from: ${6:0.0}, to: ${7:1.0}, count: ${8:3}}, unit: ${9:m/s}}
metrics:
  ${10:error}: ${11:rms(norm(hull.eta[1:2]))}
""",
    ),
    "training": (
        "The configuration of a training",
        """\
task: ${1:source}
algorithm: ${2:masac}
seed: ${3:0}
steps: ${4:96000}
settings: {${5:lr}: ${6:3.0e-4}}
""",
    ),
    "curriculum": (
        "A curriculum: tasks one after the other",
        """\
name: ${1:my_schooling}
algorithm: ${2:masac}
stages:
  - task: ${3:source}
    steps: ${4:32000}
    promotion: {share: ${5:0.9}}
  - task: ${6:target}
    steps: ${7:64000}
""",
    ),
    "access": (
        "An access file: users of a served system",
        """\
users:
  ${1:ann}: {role: ${2:owner}, password: "${3:scrypt$ as `uuvsim access password` prints it}"}
anyone: ${4:none}
listen: [${5:127.0.0.1}]
""",
    ),
    "scenario": (
        "A scenario: changes and faults at given times",
        """\
name: ${1:my_scenario}
events:
  - {at: ${2:20}, until: ${3:60}, signal: ${4:dvl.t_sample}, fault: ${5:drop}, value: ${6:0.5}}
  - {at: ${7:90}, set: ${8:guidance.speed}, value: ${9:0.3 m/s}}
""",
    ),
    "topics": (
        "ROS 2 topics of a recording",
        """\
topics:
  - topic: ${1:/imu/data_raw}
    type: ${2:sensor_msgs/msg/Imu}
    frame: ${3:imu_link}
    signals: {${4:gyro: imu.gyro, acc: imu.acc}}
""",
    ),
    "mapping": (
        "Settings of a survey's map",
        """\
scene: ${1:tacoma}
cell: ${2:0.1}
sensors:
  - component: ${3:multibeam}
""",
    ),
}
_COMPONENT = '''\
class ${1:MyComponent}:
    """${2:What it computes.}"""

    inputs = {"${3:u}": "${4:1}"}
    outputs = {"${5:y}": "${6:1}"}

    def step(self, t, dt, u):
        """Return all outputs, valid at t + dt, from the inputs at t."""
        return {"${5:y}": ${7:0.0}}
'''


def snippets() -> dict[str, dict[str, object]]:
    """Return the content of a .code-snippets file."""
    found: dict[str, dict[str, object]] = {}
    for schema, (description, text) in _YAML.items():
        modeline = rf"# yaml-language-server: \$schema=.vscode/schemas/{schema}.schema.json"
        found[f"uuvsim {schema}"] = {
            "scope": "yaml",
            "prefix": f"uuvsim-{schema}",
            "description": description,
            "body": [modeline, *text.splitlines()],
        }
    found["uuvsim component"] = {
        "scope": "python",
        "prefix": "uuvsim-component",
        "description": "A component in Python",
        "body": _COMPONENT.splitlines(),
    }
    return found
