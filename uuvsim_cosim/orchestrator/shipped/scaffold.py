"""Templates for a user's component: source text whose connectors fit a slot."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from string import Template
from xml.sax.saxutils import quoteattr

from uuvsim_cosim.cache import content_hash
from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.element_names import element_names
from uuvsim_cosim.models.declaration.units import BASE, parse_unit
from uuvsim_cosim.orchestrator.system.slot import Slot, SlotConnector

__all__ = ["KINDS", "c_files", "class_name", "files_for", "is_controller", "write_scaffold"]

PD_GAINS = {"Kp": (120, 120, 160, 8, 8, 16), "Kd": (90, 90, 110, 3, 3, 6)}
BUILD_SCRIPT = '''\
"""Builds {model}.fmu for this machine, with the C compiler that comes with uuvsim-cosim."""

from pathlib import Path

from uuvsim_cosim.fmus.export.fmu_file import fmi_headers, write_archive
from uuvsim_cosim.fmus.codegen.toolchain import compile_shared, host

here = Path(__file__).parent
flags = ["-DFMI2_FUNCTION_PREFIX=", "-fvisibility=default"]
library = compile_shared([here / "{model}.c"], name="{model}", include=[fmi_headers()], flags=flags)
members = {{
    "modelDescription.xml": (here / "modelDescription.xml").read_bytes(),
    f"binaries/{{host().fmi2}}/{model}{{host().suffix}}": library.read_bytes(),
    "sources/{model}.c": (here / "{model}.c").read_bytes(),
}}
write_archive(here / "{model}.fmu", members)
print(here / "{model}.fmu")
'''


def c_files(slot: Slot) -> dict[str, str]:
    """Return the C source, the model description, and the script that builds the FMU."""
    model = f"my_{slot.path.rpartition('.')[2]}"
    law = is_controller(slot)
    rows: list[tuple[str, str, int, tuple[str | None, ...]]] = [
        (c.name, c.direction, c.shape[0] if c.shape else 0, c.units) for c in slot.connectors
    ]
    rows += [(name, "parameter", 6, ("1",) * 6) for name in PD_GAINS] if law else []
    place, places, variables = 0, [], []
    for name, causality, size, units in rows:
        places.append(f"{name.upper().replace('.', '_')} = {place}")
        for i, element in enumerate(element_names(name, (size,) if size else ())):
            start = float(PD_GAINS[name][i]) if causality == "parameter" else 0.0
            variables.append((element, place + i, causality, units[i], start))
        place += max(size, 1)
    starts = "".join(
        f"    self->v[{at}] = {start!r};\n"
        for _, at, causality, _, start in variables
        if causality == "parameter"
    )
    outputs = [name for name, causality, _, _ in rows if causality == "output"]
    zero = "".join(
        f"    v[{name.upper().replace('.', '_')}] = 0.0; /* your law here */\n" for name in outputs
    )
    template, pd_law = (
        (content("orchestrator", "templates") / name).read_text(encoding="utf-8")
        for name in ("component.c", "pd_law.c")
    )
    source = Template(template).substitute(
        path=slot.path,
        places=",\n       ".join(places) + f", END = {place - 1}",
        body=pd_law if law else zero,
        starts=starts,
    )
    return {
        f"{model}/{model}.c": source,
        f"{model}/modelDescription.xml": _description(model, variables, source),
        f"{model}/build.py": BUILD_SCRIPT.format(model=model),
    }


def _description(
    model: str, variables: list[tuple[str, int, str, str | None, float]], source: str
) -> str:
    units = sorted({unit for _, _, _, unit, _ in variables if unit})
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<fmiModelDescription fmiVersion="2.0" modelName="{model}" '
        f'guid="{content_hash([source])}" variableNamingConvention="structured">',
        f'  <CoSimulation modelIdentifier="{model}" canHandleVariableCommunicationStepSize="true" '
        'canGetAndSetFMUstate="true"/>',
        "  <UnitDefinitions>",
    ]
    for name in units:
        unit = parse_unit(name)
        given = {b: str(e) for b, e in zip(BASE, unit.exponents, strict=True) if e}
        given |= {"factor": repr(unit.factor)} if unit.factor != 1.0 else {}
        given |= {"offset": repr(unit.offset)} if unit.offset != 0.0 else {}
        base = "".join(f' {key}="{value}"' for key, value in given.items())
        lines.append(f"    <Unit name={quoteattr(name)}><BaseUnit{base}/></Unit>")
    lines += ["  </UnitDefinitions>", "  <ModelVariables>"]
    for name, at, causality, named, start in variables:
        variability = "tunable" if causality == "parameter" else "continuous"
        begins = "" if causality == "output" else f' start="{start!r}"'
        united = f" unit={quoteattr(named)}" if named else ""
        lines.append(
            f'    <ScalarVariable name="{name}" valueReference="{at}" causality="{causality}" '
            f'variability="{variability}"><Real{united}{begins}/></ScalarVariable>'
        )
    outputs = [
        f'      <Unknown index="{i}" dependencies=""/>'
        for i, (_, _, causality, _, _) in enumerate(variables, 1)
        if causality == "output"
    ]
    lines += ["  </ModelVariables>", "  <ModelStructure>"]
    lines += ["    <Outputs>", *outputs, "    </Outputs>"]
    lines += ["    <InitialUnknowns>", *outputs, "    </InitialUnknowns>"]
    return "\n".join([*lines, "  </ModelStructure>", "</fmiModelDescription>", ""])


def is_controller(slot: Slot) -> bool:
    """Return whether the slot has a controller's connectors: eta_d, eta, nu -> tau_d."""
    inputs = {c.name for c in slot.connectors if c.direction == "input" and c.shape == (6,)}
    outputs = [c.name for c in slot.connectors if c.direction == "output"]
    return {"eta_d", "eta", "nu"} <= inputs and outputs == ["tau_d"]


def files_for(slot: Slot, kind: str) -> dict[str, str]:
    """Return the files, by name, of a component; `kind` is one of `KINDS`. Raises InputInvalid."""
    if kind not in KINDS:
        raise InputInvalid(f"--as {kind}: expected one of {', '.join(KINDS)}")
    odd = [c.name for c in slot.connectors if not c.type.startswith("Float") or len(c.shape) > 1]
    if odd:
        raise InputInvalid(
            f"slot {slot.path}", f"{', '.join(odd)} are no floats or vectors", "only those"
        )
    return KINDS[kind](slot)


def write_scaffold(slot: Slot, kind: str, folder: Path) -> list[Path]:
    """Write the files of `files_for` into a folder; raises InputInvalid if one exists already."""
    files = {folder / name: text for name, text in files_for(slot, kind).items()}
    existing = [path.name for path in files if path.exists()]
    if existing:
        listed = ", ".join(existing)
        raise InputInvalid(folder, f"{listed} exist already", "another folder")
    try:
        for path, text in files.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputInvalid(f"{folder}: cannot be written ({error.strerror})") from None
    return list(files)


def class_name(slot: Slot) -> str:
    """Return the name of the component's class: My and the slot's last name."""
    words = re.split(r"\W|_", slot.path.rpartition(".")[2])
    return "My" + "".join(word.capitalize() for word in words)


def _file_name(slot: Slot) -> str:
    return f"my_{slot.path.rpartition('.')[2]}"


def _of(slot: Slot, direction: str) -> list[SlotConnector]:
    return [c for c in slot.connectors if c.direction == direction]


def _size(connector: SlotConnector) -> int:
    return connector.shape[0] if connector.shape else 1


# ---- a Python class -----------------------------------------------------------------------------

PD_LAW = """\
        e = u["eta_d"] - u["eta"]  # N E D [m], phi theta psi [rad]
        e[3:] = (e[3:] + np.pi) % (2 * np.pi) - np.pi
        psi = u["eta"][5]
        e[:2] = [np.cos(psi) * e[0] + np.sin(psi) * e[1], np.cos(psi) * e[1] - np.sin(psi) * e[0]]
        tau = np.array(self.Kp) * e - np.array(self.Kd) * u["nu"]
"""


def _python(slot: Slot) -> dict[str, str]:
    def declared(connector: SlotConnector) -> str:
        units = [u or "1" for u in connector.units]
        unit = f'"{units[0]}"' if len(set(units)) == 1 else str(tuple(units)).replace("'", '"')
        shown = f"({_size(connector)}, {unit})" if connector.shape else unit
        remark = f"  # {connector.description}" if connector.description else ""
        return f'        "{connector.name}": {shown},{remark}\n'

    name = class_name(slot)
    law = is_controller(slot)
    parameters = (
        "    parameters = {\n"
        '        "Kp": ([120.0, 120.0, 160.0, 8.0, 8.0, 16.0], "1"),\n'
        '        "Kd": ([90.0, 90.0, 110.0, 3.0, 3.0, 6.0], "1"),\n'
        "    }\n"
    )
    values = ", ".join(f'"{c.name}": {"tau" if law else _zero(c)}' for c in _of(slot, "output"))
    body = PD_LAW if law else "        # Your control law here; u contains the inputs by name.\n"
    text = (
        f'"""A component for the slot {slot.path!r}; change step() to what you want."""\n\n'
        + ("import numpy as np\n\n\n" if law or "np." in values else "\n")
        + f"class {name}:\n"
        + f'    """Replaces {slot.path}."""\n\n'
        + "    inputs = {\n"
        + "".join(declared(c) for c in _of(slot, "input"))
        + "    }\n    outputs = {\n"
        + "".join(declared(c) for c in _of(slot, "output"))
        + "    }\n"
        + (parameters if law else "")
        + "\n    def step(self, t, dt, u):\n"
        + '        """Return all outputs, valid at t + dt, from the inputs at t."""\n'
        + body
        + f"        return {{{values}}}\n"
    )
    file = f"{_file_name(slot)}.py"
    return {file: text}


def _zero(connector: SlotConnector) -> str:
    return f"np.zeros({_size(connector)})" if connector.shape else "0.0"


# ---- an FMI 3.0 FMU by pythonfmu3 -------------------------------------------------------------

PYTHONFMU3 = '''\
"""A component for the slot {path!r} as an FMU; change law() to what you want.

Build it with  pythonfmu3 build -f {file}
"""

import numpy as np
from pythonfmu3 import Dimension, Float64, Fmi3Causality, Fmi3Slave, Fmi3Variability

INPUTS = {inputs}
OUTPUTS = {outputs}


class {name}(Fmi3Slave):
    """Replaces {path}."""

    author = "me"

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.time = 0.0
        self.register_variable(
            Float64(
                "time",
                causality=Fmi3Causality.independent,
                variability=Fmi3Variability.continuous,
            )
        )
{gains}        self.values = {{}}
        for name, size in INPUTS.items():
            self.connector(name, size, Fmi3Causality.input)
        for name, size in OUTPUTS.items():
            self.connector(name, size, Fmi3Causality.output)

    def connector(self, name, size, causality):
        """Register a scalar (size 0) or a vector."""
        self.values[name] = np.zeros(size) if size else 0.0
        self.register_variable(
            Float64(
                name,
                causality=causality,
                variability=Fmi3Variability.continuous,
                dimensions=[Dimension(start=str(size))] if size else [],
                getter=lambda: list(self.values[name]) if size else self.values[name],
                setter=lambda x: self.values.__setitem__(name, np.array(x) if size else x),
            ),
            nested=False,
        )

    def do_step(self, current_time, step_size):
        """Set the outputs, valid at current_time + step_size."""
        self.values.update(self.law(current_time, step_size, self.values))
        return True

    def law(self, t, dt, u):
        """Give all outputs by name."""
{body}        return {{{values}}}
'''
GAINS = """\
        self.Kp, self.Kd = 1.0, 1.0  # factors on the gains below
        for name in ("Kp", "Kd"):
            self.register_variable(
                Float64(
                    name, causality=Fmi3Causality.parameter, variability=Fmi3Variability.tunable
                )
            )
"""


def _pythonfmu3(slot: Slot) -> dict[str, str]:
    law = is_controller(slot)
    body = PD_LAW.replace("np.array(self.Kp)", "self.Kp * np.array([120, 120, 160, 8, 8, 16])")
    body = body.replace("np.array(self.Kd)", "self.Kd * np.array([90, 90, 110, 3, 3, 6])")
    body = body.replace(" + self.Kd", "\n            + self.Kd").replace(
        "        tau = self.Kp * np.array([120, 120, 160, 8, 8, 16]) * e - self.Kd",
        "        tau = self.Kp * np.array([120, 120, 160, 8, 8, 16]) * e\n        tau -= self.Kd",
    )
    values = ", ".join(f'"{c.name}": {"tau" if law else _zero(c)}' for c in _of(slot, "output"))
    file = f"{_file_name(slot)}_fmu.py"
    text = PYTHONFMU3.format(
        path=slot.path,
        file=file,
        name=class_name(slot),
        inputs={c.name: c.shape[0] if c.shape else 0 for c in _of(slot, "input")},
        outputs={c.name: c.shape[0] if c.shape else 0 for c in _of(slot, "output")},
        gains=GAINS if law else "",
        body=body if law else "        # Your control law here; u contains the inputs by name.\n",
        values=values,
    )
    return {file: text.replace("'", '"')}


KINDS: dict[str, Callable[[Slot], dict[str, str]]] = {
    "python": _python,
    "pythonfmu3": _pythonfmu3,
    "c": c_files,
}
