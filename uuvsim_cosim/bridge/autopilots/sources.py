"""Sources of autopilots: their connectors and options, which need no binary."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl, urlencode

import numpy as np

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.description import (
    Causality,
    Description,
    Variability,
    Variable,
    VariableType,
)
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.orchestrator.system.sources import Backend

__all__ = ["AutopilotSource", "described", "read_options", "variable"]

_POSE = ("m", "m", "m", "rad", "rad", "rad")
_TWIST = ("m/s", "m/s", "m/s", "rad/s", "rad/s", "rad/s")


def variable(
    name: str, causality: Causality, start: Any, unit: str | Sequence[str] | None,
    description: str, type: VariableType = "Float64",
) -> Variable:  # fmt: skip
    """Return a variable; its shape is that of its start value, and `unit` may be one each."""
    shape = np.shape(start)
    changes: Variability = "continuous" if type == "Float64" else "discrete"
    return Variable(
        name, type, causality, "fixed" if causality == "parameter" else changes, shape,
        unit if isinstance(unit, str) else None,
        np.array(start, np.int32 if type == "Int32" else float) if shape else start,
        description=description, dependencies=() if causality == "output" else None,
        element_units=() if unit is None or isinstance(unit, str) else tuple(unit),
    )  # fmt: skip


def described(scheme: str, description: str, modes: str, own: Sequence[Variable]) -> Description:
    """Return the interface of an autopilot: the connectors that all have, and its `own`."""
    zero3, zero6 = [0.0] * 3, [0.0] * 6
    variables = [
        variable("eta", "input", zero6, _POSE, "pose of the hull in n, N E D phi theta psi"),
        variable("q", "input", [1.0, 0, 0, 0], "1", "its attitude, from b to n"),
        variable("nu", "input", zero6, _TWIST, "its velocity over ground, of CO in b"),
        variable("nu_dot", "input", zero6, ("m/s2",) * 3 + ("rad/s2",) * 3, "derivative of nu"),
        variable("voltage", "input", 16.0, "V", "of the battery"),
        variable("current", "input", 0.0, "A", "of the battery"),
        variable("altitude", "input", 0.0, "m", "range of the altimeter"),
        variable("dvl_velocity", "input", zero3, "m/s", "of the DVL, body axes"),
        variable("dvl_valid", "input", False, None, "the DVL has a bottom track", "Boolean"),
        variable("dvl_t_sample", "input", -1.0, "s", "time of the DVL's reading"),
        variable("usbl_position", "input", zero3, "m", "of the transponder in NED"),
        variable("usbl_sigma", "input", [1.0] * 3, "m", "deviations of N, E, D"),
        variable("usbl_valid", "input", False, None, "the USBL has a fix", "Boolean"),
        variable("usbl_t_sample", "input", -1.0, "s", "time of the USBL's fix"),
        variable("arm", "input", False, None, "arm the motors; sent until confirmed", "Boolean"),
        variable("mode", "input", 0, None, modes, "Int32"),
        variable("manual", "input", zero6, "1", "pilot: surge, sway, heave, roll, pitch, yaw, "
                 "-1 to 1"),
        variable("eta_d", "input", zero6, _POSE, "desired pose in mode guided: N E D and psi"),
        variable("nu_d", "input", zero6, _TWIST, "its velocity, u v w; 0 throughout: a waypoint"),
        variable("warm_up", "parameter", 45.0, "s", "time at rest before the start, in which the "
                 "autopilot estimates its state"),
        variable("g", "parameter", 9.80665, "m/s2", "gravity that its accelerometers measure"),
        variable("setpoint_period", "parameter", 0.1, "s", "between two desired poses"),
        variable("u", "output", [0.0] * 8, "1", "commands of the thrusters, -1 to 1"),
        variable("lights", "output", 0.0, "1", "brightness, 0 to 1"),
        variable("gripper", "output", 0.0, "1", "-1: closing, 1: opening"),
        variable("tilt", "output", 0.0, "1", "tilt of the camera, -1 to 1"),
        *own,
        variable("armed", "output", False, None, "the autopilot is armed", "Boolean"),
        variable("mode_now", "output", -1, None, "mode of its last heartbeat", "Int32"),
        variable("frame", "output", 0.0, "1", "packets since its start"),
        variable("setpoint_kind", "output", 0, None, "desired pose that was sent last: 0 none, "
                 "1 a waypoint, 2 a target that moves", "Int32"),
        variable("setpoint_pose", "output", [0.0] * 4, ("m", "m", "m", "rad"),
                 "N E D and psi that were sent"),
        variable("setpoint_velocity", "output", zero3, "m/s", "N E D that were sent"),
        variable("pilot", "output", zero6, "1", "axes of `manual` that were sent"),
        variable("has_target", "output", False, None, "the autopilot has reported a target in the "
                 "last 1.5 s", "Boolean"),
        variable("target", "output", zero3, "m", "N E D to which the autopilot reports to go"),
    ]  # fmt: skip
    return Description(
        scheme, "python", {v.name: v for v in variables}, description=description,
        can_get_and_set_state=False, can_serialize_state=False, can_handle_variable_step=False,
    )  # fmt: skip


def read_options(
    text: str, base: Path, known: Mapping[str, str], seconds: Sequence[str], paths: Sequence[str]
) -> dict[str, str]:
    """Read ``scheme:?option=value&…``; raises InputInvalid.

    `known` has the default of each option. Options `seconds` are more than 0, and `paths` are
    relative to `base`; they become absolute. `instance` is a number or `auto`.
    """
    given = dict(parse_qsl(text.partition("?")[2], keep_blank_values=True))
    unknown = [name for name in given if name not in known]
    if unknown:
        raise InputInvalid(f"source {text!r}", f"option {unknown[0]!r}",
                           expected_names(unknown[0], known))  # fmt: skip
    options = {**known, **given}
    if options["instance"] != "auto" and not options["instance"].isdecimal():
        raise InputInvalid(f"source {text!r}", f"instance {options['instance']!r}", "0 or more")
    for name in seconds:
        try:
            value = float(options[name])
        except ValueError:
            value = math.nan
        if not 0.0 < value < math.inf:
            raise InputInvalid(f"source {text!r}", f"{name} {options[name]!r}", "seconds")
    for name in paths:
        if options[name]:
            options[name] = str((base / Path(options[name]).expanduser()).absolute())
    return options


@dataclass(frozen=True)
class AutopilotSource:
    """An autopilot with its options; `make` makes the component from them and a path."""

    options: tuple[tuple[str, str], ...]
    defaults: Mapping[str, str]
    description: Description
    make: Callable[[dict[str, str], str], Component]
    kind: str

    @property
    def text(self) -> str:
        """The whole source, with absolute paths."""
        given = [(n, v) for n, v in self.options if v != self.defaults[n]]
        query = f"?{urlencode(given, safe='/:~')}" if given else ""
        return f"{self.description.name}:{query}"

    def describe(self) -> Description:
        """Return the interface; needs no binary."""
        return self.description

    def instantiate(self, path: str, *, backend: Backend = "fmu") -> Component:
        """Make the component `path`; raises InputInvalid without the autopilot's binary."""
        return self.make(dict(self.options), path)
