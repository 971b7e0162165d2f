"""One run for `conformance`, as a process: an FMU against a reference or FMPy, or a system."""

from __future__ import annotations

import json
import logging
import os
import sys
import tempfile
from collections.abc import Mapping, Sequence
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import numpy as np

from uuvsim_cosim.errors import ComponentFailed, FmuError, UuvsimError
from uuvsim_cosim.fmus.check.inspect_fmu import reliance
from uuvsim_cosim.fmus.check.reference_result import (
    Reference,
    default_experiment,
    deviations,
    references,
)
from uuvsim_cosim.fmus.check.simulate_fmu import simulate_fmu
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.fmus.importer.read_description import FmuArchive, read_fmu
from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_fmu

__all__ = ["judge"]

# Of the largest value of a column. The solver of Model Exchange is not FMPy's, so that only a
# coarse agreement can be asked for.
SAME_STEPS, OTHER_SOLVER = 1e-9, 1e-2
SOLVER_SHARE = 1e3  # the least range of a column is this times the tolerance of the solver
DEFAULT_STEP = 0.01  # [s] if the FMU states none


def judge(path: Path, interface: str, until: float, libcosim: str = "") -> tuple[str, str]:
    """Run an FMU or a system; return the result and its detail, also for an error.

    `libcosim` is an interpreter that has libcosimpy, for systems.
    """
    try:
        if path.suffix.lower() == ".fmu":
            return _fmu(read_fmu(path, interface or None), until)
        return _system(path, until, libcosim)
    except UuvsimError as error:
        text = str(error).replace(f"{path.parent}/", "")
        return ("refused" if error.exit_status == 2 else "failed"), text


def _fmu(fmu: FmuArchive, until: float) -> tuple[str, str]:
    runs = reliance(fmu)["run"]
    if runs.startswith("no"):
        return "refused", f"{runs.removeprefix('no: ')}; there: {', '.join(fmu.binaries) or 'none'}"
    if fmu.description.has_event_mode and fmu.description.clocks:
        return _ticking(fmu, until)
    texts: list[str] = []
    own: list[Reference] = []
    try:
        own += references(fmu)
    except FmuError as error:  # the FMU may be right where its reference is not
        texts.append(f"its reference cannot be used: {error}")
    own += _beside(fmu)
    for reference in own:
        x = instantiate_fmu(fmu, "conformance")
        try:
            off, summary = deviations(fmu, x, reference)
        except FmuError as error:
            texts.append(f"its reference cannot be used: {error}")
            break
        finally:
            x.free()
        texts += off[:1] or [summary]
        if off and fmu.interface != "ModelExchange":
            return "deviates", off[0]
        if not off and reference is own[-1]:
            return "equal", "; ".join(texts)
    result, text = _beside_fmpy(fmu, until)
    return result, "; ".join([text, *texts])


def _ticking(fmu: FmuArchive, until: float) -> tuple[str, str]:
    """Run an FMU with clocks alone, with events; neither FMPy nor fmi-ls-ref has its ticks."""
    from uuvsim_cosim.orchestrator.running.run import run
    from uuvsim_cosim.orchestrator.system.system import System

    start, stop, step = default_experiment(fmu)
    end = min(stop if stop is not None and stop > start else start + until, start + until)
    tick = Fraction(str(step or DEFAULT_STEP))
    with tempfile.TemporaryDirectory() as scratch:
        system = System("conformance", tick).add("fmu", str(fmu.path)).with_events()
        done = run(system, until=end, out=Path(scratch) / "run", progress=False)
    n = sum(e.cause.startswith("clock ") for e in done.events or ())
    return "runs", f"with events, to {end:g} s; its clocks tick {n} times, without a reference"


def _beside(fmu: FmuArchive) -> list[Reference]:
    """Return a result beside the FMU: NAME_ref.csv or NAME_out.csv, with inputs in NAME_in.csv."""
    for ending in ("_ref.csv", "_out.csv"):
        result = fmu.path.with_name(fmu.path.stem + ending)
        inputs = fmu.path.with_name(f"{fmu.path.stem}_in.csv")
        if result.is_file():
            given = inputs if inputs.is_file() else None
            return [Reference(result.name, result, given, start_time=fmu.default_start_time or 0.0)]
    return []


def _beside_fmpy(fmu: FmuArchive, until: float) -> tuple[str, str]:
    """Simulate the default experiment, for at most `until` s, here and by FMPy, in equal steps."""
    start, stop, step = default_experiment(fmu)
    end = min(stop if stop is not None and stop > start else start + until, start + until)
    h = step or DEFAULT_STEP
    n = max(1, round((end - start) / h))
    runs = f"{n} steps of {h:.6g} s"
    points = [start + k * h for k in range(n + 1)]  # as FMPy computes them
    try:
        ours = (
            _stepped(fmu, points) if fmu.interface != "ModelExchange" else _integrated(fmu, points)
        )
    except ComponentFailed as error:
        if error.asks_to_end:
            return "runs", f"{error}"
        return "failed", f"{error}{_of_fmpy(fmu, points)}"
    if not ours:
        return "runs", f"{runs}; it has no output that is a number"
    if fmu.interface == "ScheduledExecution":
        return "runs", f"{runs}; FMPy has no Scheduled Execution to compare it with"
    try:
        theirs = _by_fmpy(fmu, points)
    except Exception as error:
        return "runs", f"{runs}; FMPy does not run it: {_first_line(error)}"
    worst, name, same = 0.0, "", True
    for column, values in ours.items():
        other = theirs[column][: len(values)]
        values = values[: len(other)]
        same &= bool(np.array_equal(values, other, equal_nan=True))
        # The solver's tolerance is also an absolute one, of a state whose nominal value is 1.
        least = 1e-12 if fmu.interface != "ModelExchange" else SOLVER_SHARE * fmu.tolerance
        scale = max(float(np.nanmax(np.abs(other))), least)
        off = float(np.nanmax(np.abs(values - other))) / scale
        if off > worst:
            worst, name = off, column
    if same:
        bad = [name for name, values in ours.items() if not np.all(np.isfinite(values))]
        more = f"; {bad[0]} becomes infinite or NaN in both" if bad else ""
        return "equal", f"FMPy: the same bits in {len(ours)} columns, {runs}{more}"
    limit = SAME_STEPS if fmu.interface != "ModelExchange" else OTHER_SOLVER
    solver = "" if fmu.interface != "ModelExchange" else ", which integrates by CVODE"
    text = f"FMPy{solver}: within {worst:.2g} of the range in {len(ours)} columns, {runs}"
    if worst <= limit:
        return "equal", text
    return "deviates", f"{text}; the most in {name}"


def _numeric(fmu: FmuArchive) -> list[Variable]:
    """Return the outputs that are numbers."""
    return [v for v in fmu.description.of("output") if v.type not in ("String", "Binary", "Clock")]


def _stepped(fmu: FmuArchive, points: Sequence[float]) -> dict[str, np.ndarray]:
    """Step by Co-Simulation, with the steps of FMPy: differences of the points."""
    x = instantiate_fmu(fmu, "conformance")
    outputs = _numeric(fmu)
    rows = []
    try:
        x.enter_initialization_mode(points[0], points[-1])
        x.exit_initialization_mode()
        for a, b in pairwise(points):
            rows.append([x.get(v) for v in outputs])
            x.do_step(a, b - a)
        rows.append([x.get(v) for v in outputs])
    finally:
        x.free()
    columns = zip(*rows, strict=True)
    return _by_element(
        outputs, {v.name: np.array(c) for v, c in zip(outputs, columns, strict=True)}
    )


def _integrated(fmu: FmuArchive, points: Sequence[float]) -> dict[str, np.ndarray]:
    """Integrate by Model Exchange."""
    outputs = _numeric(fmu)
    names = [v.name for v in outputs]
    step = Fraction(str(round(points[1] - points[0], 12)))
    done = simulate_fmu(fmu, until=round(points[-1], 12), step=step, outputs=names)
    return _by_element(outputs, done.columns)


def _by_fmpy(fmu: FmuArchive, points: Sequence[float]) -> dict[str, np.ndarray]:
    """Simulate by FMPy at the same communication points."""
    from fmpy import read_model_description
    from fmpy import simulate_fmu as simulate_by_fmpy

    outputs = _numeric(fmu)
    described = read_model_description(str(fmu.path), validate=False)
    steps = fmu.interface != "ModelExchange"
    if steps and described.defaultExperiment is not None:
        # FMPy would hand it to the FMU's own solver, for which there is none here.
        described.defaultExperiment.tolerance = None
    arrays = fmu.description.kind == "FMI 3.0"
    names = [n for v in outputs for n in ([v.name] if arrays else v.element_names)]
    table = simulate_by_fmpy(
        str(fmu.path), validate=False, fmi_type=fmu.interface, start_time=points[0],
        stop_time=points[-1], output_interval=points[1] - points[0], output=names,
        record_events=False, relative_tolerance=None if steps else 1e-8,
        model_description=described,
    )  # fmt: skip
    columns = {n: np.asarray(table[n], dtype=float) for n in names}
    return _by_element(outputs, columns) if arrays else columns


def _by_element(
    outputs: Sequence[Variable], columns: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Return a column for each element of an array."""
    found: dict[str, np.ndarray] = {}
    for v in outputs:
        flat = np.asarray(columns[v.name], dtype=float).reshape(len(columns[v.name]), -1)
        found |= {name: flat[:, i] for i, name in enumerate(v.element_names)}
    return found


def _of_fmpy(fmu: FmuArchive, points: Sequence[float]) -> str:
    """Return what FMPy reports on a run that failed here."""
    try:
        columns = _by_fmpy(fmu, points)
    except Exception as error:
        return f"; in FMPy: {_first_line(error)}"
    bad = [name for name, values in columns.items() if not np.all(np.isfinite(values))]
    return f"; in FMPy, {bad[0]} is not finite either" if bad else "; FMPy runs it"


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]


def _system(path: Path, until: float, libcosim: str) -> tuple[str, str]:
    """Run a system for at most `until` s; compare it with libcosim if that is given."""
    from uuvsim_cosim.orchestrator.plan.flatten import plan_to_inspect
    from uuvsim_cosim.orchestrator.running.conformance_libcosim import beside_libcosim
    from uuvsim_cosim.orchestrator.running.library import load
    from uuvsim_cosim.orchestrator.running.run import run

    system = load(path)
    plan, refused = plan_to_inspect(system)
    if "algebraic loop" in refused:  # the user's choice, which other masters make in silence
        system = system.with_loops("delay")
        refused = f"with --loops delay, because a run refuses by default: {refused}"
    end = min(system.stop_time or until, system.start_time + until)
    result, beside = "runs", ""
    with tempfile.TemporaryDirectory() as scratch:
        done = run(system, until=end, out=Path(scratch) / "run", progress=False)
        if libcosim:
            outputs = {
                c.path: [n for v in c.description.of("output") if v.type == "Float64"
                         for n in v.element_names]
                for c in plan.components
            }  # fmt: skip
            result, beside = beside_libcosim(libcosim, path, plan.tick, done.signals(), outputs)
    notes = len({*plan.warnings, *system.notes})
    more = f", {notes} assumptions and warnings" if notes else ""
    more += f", {refused}" if refused else ""
    text = f"{len(plan.components)} components, to {end:g} s{more}"
    return result, f"{beside}; {text}" if beside else text


def main() -> None:
    """Write the result of one subject into a file, as JSON."""
    path, interface, until, libcosim, target = sys.argv[1:]
    file, subject = Path(target).resolve(), Path(path).resolve()
    logging.disable(logging.WARNING)
    with tempfile.TemporaryDirectory() as scratch:
        os.chdir(scratch)  # for FMUs that write into the working directory
        found = judge(subject, interface, float(until), libcosim)
        file.write_text(json.dumps(found), encoding="utf-8")
        os.chdir("/")


if __name__ == "__main__":
    main()
