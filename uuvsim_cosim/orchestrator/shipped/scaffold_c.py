"""Template of a component in C: FMI 2.0 on one array of doubles, and a script that builds it."""

from __future__ import annotations

from xml.sax.saxutils import quoteattr

from uuvsim_cosim.cache import content_hash
from uuvsim_cosim.models.declaration.element_names import element_names
from uuvsim_cosim.orchestrator.system.slot import Slot

__all__ = ["c_files", "is_controller"]

SOURCE = """\
/* A component for the slot "{path}"; change law() to what you want.
   All variables lie in one array, and a value reference is an index into it. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "fmi2Functions.h"

enum {{ {places}, SIZE }};

typedef struct {{
    double v[SIZE];
    double t;
}} Instance;

/* Sets the outputs, valid at t + dt, from the inputs at t. */
static void law(double *v, double t, double dt)
{{
    (void)t;
    (void)dt;
{body}}}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String token,
                              fmi2String resources, const fmi2CallbackFunctions *callbacks,
                              fmi2Boolean visible, fmi2Boolean logging)
{{
    (void)name, (void)token, (void)resources, (void)callbacks, (void)visible, (void)logging;
    Instance *c = type == fmi2CoSimulation ? calloc(1, sizeof(Instance)) : NULL;
    if (c) fmi2Reset(c);
    return c;
}}

fmi2Status fmi2Reset(fmi2Component c)
{{
    Instance *self = c;
    memset(self, 0, sizeof *self);
{starts}    return fmi2OK;
}}

void fmi2FreeInstance(fmi2Component c) {{ free(c); }}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{{
    for (size_t i = 0; i < n; i++) {{
        if (vr[i] >= SIZE) return fmi2Error;
        value[i] = ((Instance *)c)->v[vr[i]];
    }}
    return fmi2OK;
}}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                       const fmi2Real value[])
{{
    for (size_t i = 0; i < n; i++) {{
        if (vr[i] >= SIZE) return fmi2Error;
        ((Instance *)c)->v[vr[i]] = value[i];
    }}
    return fmi2OK;
}}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real dt, fmi2Boolean keeps)
{{
    (void)keeps;
    law(((Instance *)c)->v, t, dt);
    return fmi2OK;
}}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{{
    if (!*state) *state = malloc(sizeof(Instance));
    if (!*state) return fmi2Error;
    memcpy(*state, c, sizeof(Instance));
    return fmi2OK;
}}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{{
    memcpy(c, state, sizeof(Instance));
    return fmi2OK;
}}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{{
    (void)c;
    free(*state);
    *state = NULL;
    return fmi2OK;
}}

/* What a component without integers, strings and derivatives must still have. */
#define EMPTY(name, ...) fmi2Status name(__VA_ARGS__)
#define REFUSED {{ return fmi2Error; }}
#define FINE {{ return fmi2OK; }}
const char *fmi2GetTypesPlatform(void) {{ return fmi2TypesPlatform; }}
const char *fmi2GetVersion(void) {{ return fmi2Version; }}
EMPTY(fmi2SetDebugLogging, fmi2Component c, fmi2Boolean on, size_t n, const fmi2String s[]) FINE
EMPTY(fmi2SetupExperiment, fmi2Component c, fmi2Boolean d, fmi2Real tol, fmi2Real t0,
      fmi2Boolean e, fmi2Real t1) FINE
EMPTY(fmi2EnterInitializationMode, fmi2Component c) FINE
EMPTY(fmi2ExitInitializationMode, fmi2Component c) FINE
EMPTY(fmi2Terminate, fmi2Component c) FINE
EMPTY(fmi2GetInteger, fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Integer v[])
REFUSED
EMPTY(fmi2GetBoolean, fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Boolean v[])
REFUSED
EMPTY(fmi2GetString, fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2String v[])
REFUSED
EMPTY(fmi2SetInteger, fmi2Component c, const fmi2ValueReference r[], size_t n,
      const fmi2Integer v[]) REFUSED
EMPTY(fmi2SetBoolean, fmi2Component c, const fmi2ValueReference r[], size_t n,
      const fmi2Boolean v[]) REFUSED
EMPTY(fmi2SetString, fmi2Component c, const fmi2ValueReference r[], size_t n,
      const fmi2String v[]) REFUSED
EMPTY(fmi2SerializedFMUstateSize, fmi2Component c, fmi2FMUstate s, size_t *n) REFUSED
EMPTY(fmi2SerializeFMUstate, fmi2Component c, fmi2FMUstate s, fmi2Byte b[], size_t n) REFUSED
EMPTY(fmi2DeSerializeFMUstate, fmi2Component c, const fmi2Byte b[], size_t n, fmi2FMUstate *s)
REFUSED
EMPTY(fmi2GetDirectionalDerivative, fmi2Component c, const fmi2ValueReference u[], size_t n,
      const fmi2ValueReference k[], size_t m, const fmi2Real a[], fmi2Real b[]) REFUSED
EMPTY(fmi2SetRealInputDerivatives, fmi2Component c, const fmi2ValueReference r[], size_t n,
      const fmi2Integer o[], const fmi2Real v[]) REFUSED
EMPTY(fmi2GetRealOutputDerivatives, fmi2Component c, const fmi2ValueReference r[], size_t n,
      const fmi2Integer o[], fmi2Real v[]) REFUSED
EMPTY(fmi2CancelStep, fmi2Component c) REFUSED
EMPTY(fmi2GetStatus, fmi2Component c, const fmi2StatusKind k, fmi2Status *s) REFUSED
EMPTY(fmi2GetRealStatus, fmi2Component c, const fmi2StatusKind k, fmi2Real *v) REFUSED
EMPTY(fmi2GetIntegerStatus, fmi2Component c, const fmi2StatusKind k, fmi2Integer *v) REFUSED
EMPTY(fmi2GetBooleanStatus, fmi2Component c, const fmi2StatusKind k, fmi2Boolean *v) REFUSED
EMPTY(fmi2GetStringStatus, fmi2Component c, const fmi2StatusKind k, fmi2String *v) REFUSED
"""
PD = """\
    double e[6], tau[6];
    for (int i = 0; i < 6; i++) {
        e[i] = v[ETA_D + i] - v[ETA + i]; /* N E D [m], phi theta psi [rad] */
        if (i >= 3) e[i] = atan2(sin(e[i]), cos(e[i]));
    }
    const double c = cos(v[ETA + 5]), s = sin(v[ETA + 5]);
    const double ahead = c * e[0] + s * e[1], across = c * e[1] - s * e[0];
    e[0] = ahead;
    e[1] = across;
    for (int i = 0; i < 6; i++) tau[i] = v[KP + i] * e[i] - v[KD + i] * v[NU + i];
    memcpy(&v[TAU_D], tau, sizeof tau);
"""
GAINS = {"Kp": (120, 120, 160, 8, 8, 16), "Kd": (90, 90, 110, 3, 3, 6)}
BUILD = '''\
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
    rows += [(name, "parameter", 6, ("1",) * 6) for name in GAINS] if law else []
    place, places, variables = 0, [], []
    for name, causality, size, units in rows:
        places.append(f"{name.upper().replace('.', '_')} = {place}")
        for i, element in enumerate(element_names(name, (size,) if size else ())):
            start = float(GAINS[name][i]) if causality == "parameter" else 0.0
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
    source = SOURCE.format(
        path=slot.path,
        places=",\n       ".join([*places[:-1], places[-1]]) + f", END = {place - 1}",
        body=PD if law else zero,
        starts=starts,
    )
    return {
        f"{model}/{model}.c": source,
        f"{model}/modelDescription.xml": _description(model, variables, source),
        f"{model}/build.py": BUILD.format(model=model),
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
        *(f"    {_unit(name)}" for name in units),
        "  </UnitDefinitions>",
        "  <ModelVariables>",
    ]
    for name, at, causality, unit, start in variables:
        variability = "tunable" if causality == "parameter" else "continuous"
        begins = "" if causality == "output" else f' start="{start!r}"'
        united = f" unit={quoteattr(unit)}" if unit else ""
        lines.append(
            f'    <ScalarVariable name="{name}" valueReference="{at}" causality="{causality}" '
            f'variability="{variability}"><Real{united}{begins}/></ScalarVariable>'
        )
    lines += ["  </ModelVariables>", "  <ModelStructure>", "    <Outputs>"]
    lines += [
        f'      <Unknown index="{i}" dependencies=""/>'
        for i, (_, _, causality, _, _) in enumerate(variables, 1)
        if causality == "output"
    ]
    lines += ["    </Outputs>", "    <InitialUnknowns>"]
    lines += [
        f'      <Unknown index="{i}" dependencies=""/>'
        for i, (_, _, causality, _, _) in enumerate(variables, 1)
        if causality == "output"
    ]
    lines += ["    </InitialUnknowns>", "  </ModelStructure>", "</fmiModelDescription>", ""]
    return "\n".join(lines)


def _unit(name: str) -> str:
    from uuvsim_cosim.models.declaration.units import BASE, parse_unit

    unit = parse_unit(name)
    powers = "".join(
        f' {base}="{power}"' for base, power in zip(BASE, unit.exponents, strict=True) if power
    )
    factor = f' factor="{unit.factor!r}"' if unit.factor != 1.0 else ""
    offset = f' offset="{unit.offset!r}"' if unit.offset != 0.0 else ""
    return f"<Unit name={quoteattr(name)}><BaseUnit{powers}{factor}{offset}/></Unit>"


def is_controller(slot: Slot) -> bool:
    """Return whether the slot has a controller's connectors: eta_d, eta, nu -> tau_d."""
    inputs = {c.name for c in slot.connectors if c.direction == "input" and c.shape == (6,)}
    outputs = [c.name for c in slot.connectors if c.direction == "output"]
    return {"eta_d", "eta", "nu"} <= inputs and outputs == ["tau_d"]
