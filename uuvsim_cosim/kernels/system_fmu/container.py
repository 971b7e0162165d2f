"""Export of a system of FMUs as one container FMU: the FMUs in its resources, stepped by the loop.

The container holds the C of the stepping loop (orchestrator/core). Its tables are the calls by
which the master makes its own, recorded, so that groups, steps and conversions are the master's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from uuvsim_cosim.cache import content_hash
from uuvsim_cosim.content import content
from uuvsim_cosim.errors import Problem, SystemInvalid
from uuvsim_cosim.fmus.codegen.runtime import runtime
from uuvsim_cosim.fmus.codegen.toolchain import host
from uuvsim_cosim.fmus.component import BindingKind, Component
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.fmus.export.model_description import FmiVersion, model_identifier
from uuvsim_cosim.fmus.export.system_fmu_file import (
    Whole,
    WholeFmu,
    compiled,
    component_table,
)
from uuvsim_cosim.fmus.importer.fmu_binary import FmuBinary
from uuvsim_cosim.fmus.importer.fmu_library import library_of
from uuvsim_cosim.kernels.system_fmu.variables import (
    Exposed,
    Naming,
    description_of,
    exposed,
    placed,
)
from uuvsim_cosim.orchestrator.master.core import Access
from uuvsim_cosim.orchestrator.master.core_library import Action, Type
from uuvsim_cosim.orchestrator.master.core_tables import Tables, fmi_name, tables_of
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.orchestrator.plan.start import seed_of
from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["build_container_fmu"]

_PAGE = """This FMU contains a system of FMUs and the loop that steps them. It makes whole
communication steps of its own, so the importer's step must be a whole multiple of them. Each step
gives the same bits as the master. Parameters and inputs are named as in the system, with _ for a
dot."""
_CLASS = {"f8": 0, "i8": 1, "u8": 2}  # of a slot


@dataclass
class _Recorded:
    """The calls by which `tables_of` makes a core, in their order."""

    n_members: int
    n_slots: int
    calls: list[tuple[str, tuple[Any, ...]]] = field(default_factory=list)

    def __getattr__(self, name: str) -> Any:
        return lambda *arguments: self.calls.append((name, arguments))


def build_container_fmu(
    system: System,
    *,
    fmi: FmiVersion = 2,
    target: Path | None = None,
    signals: Sequence[str] = (),
    inputs: Sequence[str] = (),
    naming: Naming = "flat",
    stop_time: float = 10.0,
) -> tuple[Path, tuple[str, ...]]:
    """Build a container .fmu for this machine; return its path and remarks.

    Its components are FMUs for Co-Simulation with a binary for this machine, and declarations,
    which become FMUs. Arguments are those of `build_system_fmu`. If Initialization Mode has an
    algebraic loop, its solution is stored, and the container has no parameters, because the
    solution may depend on them; a remark reports it. Raises SystemInvalid with every component
    that is neither, InputInvalid, ToolchainError.
    """
    plan = flatten(system)
    looped = any(len(entry) > 1 for entry in plan.initialization)
    with Master(plan, prepare(plan), measured=False) as master:
        _expect_fmus(plan, master.components)
        shown = exposed(plan, naming=naming, signals=signals, inputs=inputs)
        if looped:
            shown = [e for e in shown if e.own.causality != "parameter"]
        before = placed([e for e in shown if e.own.causality != "output"], 1)
        at = 1 + sum(e.shown.size for e in before)
        every = [*before, *placed([e for e in shown if e.own.causality == "output"], at)]
        solution: list[tuple[int, Variable, Any]] = []
        if looped:
            master.initialize()
            solution += [
                (i, v, master.get(c.path, v.name))
                for i, c in enumerate(plan.components)
                for v in c.description.of("input")
                if (i, v.name) in plan.connected
            ]
        recorded, tables = _tables(plan, master.components, every)
        text = _text(plan, master.components, every, recorded, tables, solution)
        boxes = [_box(i, c) for i, c in enumerate(master.components) if isinstance(c, FmuBinary)]
    description = description_of(system.name, system.description, plan, every, [])
    identifier = model_identifier(system.name)
    core = content("orchestrator", "core")
    folders = [core, core / "components", core / "iteration"]
    files = {f.name: f.read_text() for each in folders for f in sorted(each.glob("*.c"))}
    members = {name: data for box in boxes for name, data in box.items()}
    own = content("fmus", "container"), content("fmus", "whole")
    headers = [own[0] / "uuv_container.h", own[1] / "uuv_whole_steps.h"]
    parts = [text, *(h.read_text() for h in headers), repr(description), *files.values()]
    token = content_hash([*parts, *(p for n in sorted(members) for p in (n, members[n]))])
    whole = Whole(identifier, description, token, plan.tick, stop_time, False, False)
    main = "\n".join([_HEAD, component_table(whole), text])
    fmu = WholeFmu(
        whole,
        {f"{identifier}.c": main, **files},
        (*own, *folders, content("fmus", "guard"), *runtime()),
        " ".join(_PAGE.split()),
        libraries={".so": ("-ldl",)},
        members=members,
    )
    path = compiled(fmu, fmi=fmi, platforms=["host"], target=target)
    remark = "algebraic loop at the start: its solution is stored, so there are no parameters"
    return path, ((remark,) if looped else ())


_HEAD = """/* Generated from a system: do not edit. */
#define UUV_WHOLE
#define _GNU_SOURCE
#include "shell_hooks.h"
/* The loop's structure has the name of one of the shells' functions. */
#define uuv_failure uuv_loop_failure
#include "uuv_core.h"
#undef uuv_failure
"""


def _expect_fmus(plan: Plan, components: Sequence[Component]) -> None:
    """Raise SystemInvalid with every component that a container cannot hold."""
    problems = []
    if host().suffix == ".dll":
        problems.append(Problem("container", "this machine, with Windows", "Linux or macOS"))
    for planned, c in zip(plan.components, components, strict=True):
        kind = c.binding().kind
        if kind not in (BindingKind.FMI2, BindingKind.FMI3) or not isinstance(c, FmuBinary):
            kind_of = "a component that the loop does not step by FMI 2.0 or 3.0"
            expected = "an FMU for Co-Simulation in this process, or a declaration"
            problems.append(Problem(planned.path, kind_of, expected))
        elif c.archive.structure:
            expected = "its own start values"
            problems.append(Problem(planned.path, "values of structural parameters", expected))
    if problems:
        raise SystemInvalid(problems)


def _tables(
    plan: Plan, components: Sequence[Component], shown: Sequence[Exposed]
) -> tuple[_Recorded, Tables]:
    """Record the calls that make the loop's tables; each step exchanges the shown values."""
    kept: list[_Recorded] = []

    def core(n_members: int, n_slots: int, _tick: object) -> Any:
        kept.append(_Recorded(n_members, n_slots))
        return kept[0]

    live = [(e.component, e.own) for e in shown if e.own.causality == "output"]
    held = [(e.component, e.own) for e in shown if e.own.causality == "input"]
    tables = tables_of(plan, components, [], live=live, held=held, core_of=core)
    return kept[0], tables


def _text(
    plan: Plan,
    components: Sequence[Component],
    shown: Sequence[Exposed],
    recorded: _Recorded,
    tables: Tables,
    solution: Sequence[tuple[int, Variable, Any]],
) -> str:
    """Return the C of the tables, and of the function that builds the loop."""
    arrays = _Arrays()
    starts: list[str] = []
    for i, (planned, c) in enumerate(zip(plan.components, components, strict=True)):
        own = seed_of(c, planned.start)
        if own is not None:
            starts.append(arrays.start(i, c, own, np.array(planned.seed, np.int32)))
        for name, value in planned.start.items():
            starts.append(arrays.start(i, c, c.description.variables[name], value))
    solved = [arrays.start(i, components[i], v, value) for i, v, value in solution]
    free: list[str] = []
    outputs: list[str] = []
    parameters: list[str] = []
    for e in shown:
        c = components[e.component]
        whole_input = e.own.causality == "input" and len(e.free) == e.own.size
        if e.own.causality == "parameter" or whole_input:
            kind = {"Float64": 0, "Int32": 1, "Boolean": 2, "Int64": 3, "Enumeration": 3}
            enumeration = e.own.type == "Enumeration" and c.binding().kind == BindingKind.FMI2
            number = 1 if enumeration or _as_int(c, e.own) else kind.get(e.own.type)
            if number is not None:
                tunable = int(e.own.variability == "tunable" and not whole_input)
                references = arrays.add("uint32_t", e.own.value_references)
                parameters.append(
                    f"{e.offset}, {e.own.size}, {e.component}, {number}, {tunable}, "
                    f'"{_type_name(c, e.own)}", {references}, {len(e.own.value_references)}'
                )
        if e.own.causality == "parameter":
            continue
        place = (tables.inputs if e.own.causality == "input" else tables.outputs)[
            e.component, e.own.name
        ]
        kind_of = _CLASS[Type.of(e.own).dtype]
        for k in e.free:
            row = f"{e.offset + k}, {place.slot + k}, {kind_of}"
            (free if e.own.causality == "input" else outputs).append(row)
    order = [] if solution else [tables.order.index(entry[0]) for entry in plan.initialization]
    boxes = []
    for i, c in enumerate(components):
        assert isinstance(c, FmuBinary)
        has = int((c.archive.folder / "resources").is_dir())
        version = 2 if c.binding().kind == BindingKind.FMI2 else 3
        texts = (c.path, c.archive.model_identifier, c.description.token, _folder(i), _library(c))
        boxes.append(", ".join(map(_c, texts)) + f", {version}, {has}")
    tick = plan.tick
    first = int(plan.start / tick)
    largest = max([1, *(e.own.size for e in shown)])
    lines = [
        f"enum {{ N_BOXES = {len(boxes)}, N_SLOTS = {recorded.n_slots}, "
        f"LARGEST_PARAMETER = {largest} }};",
        f"static const uint64_t tick_num = {tick.numerator}u, tick_den = {tick.denominator}u, "
        f"first_tick = {first}u;",
        "typedef struct { const char *name, *identifier, *token, *folder, *library; int fmi, "
        "has_resources; } box;",
        "typedef struct { uint32_t box; const char *type; const uint32_t *references; "
        "uint32_t n_references; const void *values; uint32_t n; } start_value;",
        "typedef struct { uint32_t b, slot, kind; } shown;",
        "typedef struct { uint32_t b, size, box, kind, tunable; const char *type; "
        "const uint32_t *references; uint32_t n_references; } shown_parameter;",
        *arrays.lines,
        *_rows("box", "boxes", "", boxes),
        *_rows("start_value", "starts", "N_STARTS", starts),
        *_rows("start_value", "solved", "N_SOLVED", solved),
        *_rows("shown", "free_inputs", "N_FREE", free),
        *_rows("shown", "shown_outputs", "N_SHOWN", outputs),
        *_rows("shown_parameter", "parameters", "N_PARAMETERS", parameters),
        f"enum {{ N_ORDER = {len(order)} }};",
        f"static const uint32_t order[] = {{{', '.join(map(str, order)) or '0'}}};",
        f"static const uint32_t member_box[] = {{{', '.join(map(str, tables.order))}}};",
        "typedef struct container container;",
        "static int build(container *x);",
        '#include "uuv_container.h"',
        *_build(recorded, tables, components),
        "",
    ]
    return "\n".join(lines)


def _build(recorded: _Recorded, tables: Tables, components: Sequence[Component]) -> list[str]:
    """Return the function that repeats the recorded calls."""
    lines = ["static int build(container *x) {", "    uuv_core *const c = x->core;"]
    ends = []
    for name, arguments in recorded.calls:
        index = arguments[0]
        if name == "member":
            _, kind, _, _, _, _, ticks, sequential, _ = arguments
            i = tables.order[index]
            prefix = "fmi2" if kind == BindingKind.FMI2 else "fmi3"
            lines += [
                f"    void *step_{index} = "
                f'function(x->inside + {i}, boxes + {i}, "{prefix}DoStep");',
                f"    if (!step_{index} || !uuv_core_member(c, {index}, {int(kind)}, "
                f"x->inside[{i}].instance, step_{index}, NULL, &x->inside[{i}].kept, {ticks}, "
                f"{int(sequential)})) return 0;",
            ]
        elif name == "access":
            lines += _access(index, arguments[1], tables, components)
        elif name == "transfer":
            target, source, slots, early, change, *more = arguments
            table = more[0] if more else ()
            pairs = ", ".join(str(v) for pair in table for v in pair)
            given = f"(const int64_t[]){{{pairs}}}" if table else "NULL"
            factor, offset = (float(v).hex() for v in change)
            lines.append(
                f"    if (!uuv_core_transfer(c, {target}, {source}, {slots[0]}, {slots[1]}, "
                f"{early}, {factor}, {offset}, {len(table)}, {given})) return 0;"
            )
        elif name == "state":
            i = tables.order[index]
            of = "fmi2" if components[i].binding().kind == BindingKind.FMI2 else "fmi3"
            word = "FMUstate" if of == "fmi2" else "FMUState"
            got = [f'function(x->inside + {i}, boxes + {i}, "{of}{verb}{word}")'
                   for verb in ("Get", "Set", "Free")]  # fmt: skip
            ends.append(f"    if (!uuv_core_state(c, {index}, {', '.join(got)}, 0)) return 0;")
        elif name == "iterate":
            first, n, solver, tolerance, limit = arguments
            ends.append(
                f"    if (!uuv_core_iterate(c, {first}, {n}, {solver}, {float(tolerance).hex()}, "
                f"{limit})) return 0;"
            )
    return [*lines, *ends, "    return 1;", "}"]


def _access(member: int, a: Access, tables: Tables, components: Sequence[Component]) -> list[str]:
    """Return the call that adds a grouped read or write."""
    i = tables.order[member]
    kind = components[i].binding().kind
    full = ("fmi2" if kind == BindingKind.FMI2 else "fmi3") + fmi_name(kind, a.action, a.type)
    action = "UUV_CORE_SET" if a.action == Action.SET else "UUV_CORE_GET"
    references = ", ".join(map(str, a.references))
    return [
        f'    {{ void *f = function(x->inside + {i}, boxes + {i}, "{full}");',
        f"    static const uint32_t references[] = {{{references}}};",
        f"    if (!f || !uuv_core_access(c, {member}, {action}, {int(a.type)}, {a.slot}, "
        f"{a.n_values}, {len(a.references)}, references, f)) return 0; }}",
    ]


class _Arrays:
    """Static arrays of C, each with a name of its own."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def add(self, type_: str, values: Sequence[object]) -> str:
        name = f"array_{len(self.lines)}"
        written = ", ".join(map(str, values)) or "0"
        self.lines.append(f"static const {type_} {name}[] = {{{written}}};")
        return name

    def start(self, box: int, c: Component, v: Variable, value: object) -> str:
        """Return a row of a value to be set, in the representation of the FMU's version."""
        flat = np.asarray(value, dtype=object).ravel().tolist()
        fmi2 = c.binding().kind == BindingKind.FMI2
        name = _type_name(c, v)
        of = {"Real": "double", "Integer": "int32_t", "Float64": "double", "Float32": "float",
              "Boolean": "int32_t" if fmi2 else "_Bool", "String": "char *const"}  # fmt: skip
        type_ = of.get(name, name.lower() + "_t")
        if name == "String":
            cells = [_c(str(x)) for x in flat]
        elif type_ in ("double", "float"):
            cells = [float(x).hex() for x in flat]
        else:
            suffix = {"int64_t": "LL", "uint64_t": "ULL"}.get(type_, "")
            cells = [f"{int(x)}{suffix}" for x in flat]
        references = self.add("uint32_t", v.value_references)
        values = self.add(type_, cells)
        n = len(v.value_references)
        return f'{box}, "{name}", {references}, {n}, {values}, {len(flat)}'


def _type_name(c: Component, v: Variable) -> str:
    """Return the type in the name of FMI's setter: Real, Float64, …."""
    return fmi_name(c.binding().kind, Action.SET, Type.of(v)).removeprefix("Set")


def _as_int(c: Component, v: Variable) -> bool:
    """Return whether the FMU takes the value as 32-bit integers: Booleans of FMI 2.0."""
    return v.type == "Boolean" and c.binding().kind == BindingKind.FMI2


def _rows(type_: str, name: str, count: str, rows: Sequence[str]) -> list[str]:
    written = [f"    {{{row}}}," for row in rows]
    head = [f"enum {{ {count} = {len(rows)} }};"] if count else []
    return [*head, f"static const {type_} {name}[] = {{", *(written or ["    {0},"]), "};"]


def _folder(i: int) -> str:
    return f"fmu_{i}"


def _library(c: FmuBinary) -> str:
    return f"binaries/{library_of(c.archive).name}"


def _box(i: int, c: FmuBinary) -> dict[str, bytes]:
    """Return the members of a contained FMU: description, library for this machine, resources."""
    folder = c.archive.folder
    description = folder / "modelDescription.xml"
    found: Mapping[str, Path] = {
        "modelDescription.xml": description,
        _library(c): library_of(c.archive),
        **{f.relative_to(folder).as_posix(): f for f in sorted((folder / "resources").rglob("*"))
           if f.is_file()},
    }  # fmt: skip
    return {f"resources/{_folder(i)}/{name}": f.read_bytes() for name, f in found.items()}


def _c(text: str) -> str:
    """Return a text as a C string, with bytes beyond ASCII in octal."""
    plain = (chr(b) if 32 <= b < 127 and chr(b) not in '"\\?' else f"\\{b:03o}"
             for b in text.encode())  # fmt: skip
    return f'"{"".join(plain)}"'
