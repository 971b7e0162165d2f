"""A system of OSP or SSP in libcosim, the reference for `conformance` beside FMPy.

An interpreter that has libcosimpy runs the system in a process of its own, and writes the values of
each step as float64.
"""

from __future__ import annotations

import json
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from fractions import Fraction
from pathlib import Path

import numpy as np

from uuvsim_cosim.errors import FmuError
from uuvsim_cosim.orchestrator.recording.signals import Signals

__all__ = ["beside_libcosim"]

TIME_LIMIT = 60.0  # [s]
# Of the range of a column. libcosim's step is a difference of two times, which differs from ours in
# the last bits; the coarser limit is for a variable step, where the lengths differ.
SAME, OTHER_STEPS = 1e-4, 1e-3
_DIGITS = "%.6g"  # as libcosim prints a number
_SAME_TIME = 2e-9  # [s] libcosim's times are whole nanoseconds
_PROGRAM = """
import array, json, sys
from libcosimpy.CosimEnums import CosimVariableType
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimObserver import CosimObserver
file, step, start, until, wanted, out = sys.argv[1:]
if file.endswith(".xml"):
    run = CosimExecution.from_osp_config_file(file)
else:
    try:
        run = CosimExecution.from_ssp_file(file)
    except AssertionError:  # a file without a step
        run = CosimExecution.from_ssp_file(file, int(step))
last = CosimObserver.create_last_value()
run.add_observer(last)
columns, reads = [], []
for slave in run.slave_infos():
    name = slave.name.decode()
    names = set(json.loads(wanted).get(name, ()))
    found = {
        v.name.decode(): v.reference for v in run.slave_variables(slave.index)
        if v.type == CosimVariableType.REAL.value and v.name.decode() in names
    }
    if found:
        columns += [f"{name}.{n}" for n in found]
        reads.append((slave.index, list(found.values())))
rows = array.array("d")
end = int(round((float(until) - float(start)) * 1e9))
while run.status().current_time < end:
    if not run.step():
        break
    rows.append(run.status().current_time * 1e-9)
    for index, references in reads:
        rows.extend(last.last_real_values(index, references))
with open(out + ".json", "w") as text:
    json.dump(columns, text)
with open(out, "wb") as data:
    rows.tofile(data)
"""


def beside_libcosim(
    python: str, file: Path, tick: Fraction, signals: Signals, outputs: Mapping[str, Sequence[str]]
) -> tuple[str, str]:
    """Compare a run with libcosim's, from the first step on; return the result and its detail.

    `outputs` has the names of each component's floating-point outputs. Where the two step at
    different times, this run is interpolated.
    """
    begin, end = float(signals.time[0]), float(signals.time[-1])
    try:
        theirs, names = _by_libcosim(python, file, tick, (begin, end), outputs)
    except FmuError as error:
        return "runs", f"libcosim does not run it: {error.problems[0].read}"
    if not len(theirs) or not names:
        return "runs", "libcosim has no value to compare"
    own = _by_element(signals, outputs)
    theirs = theirs[theirs[:, 0] + begin <= end + _SAME_TIME]
    times = theirs[:, 0] + begin
    at = np.clip(np.searchsorted(signals.time, times - _SAME_TIME), 0, len(signals.time) - 1)
    there = np.abs(signals.time[at] - times) <= _SAME_TIME
    worst, where, bits, digits = 0.0, "", True, True
    for i, name in enumerate(names, 1):
        mine = np.where(there, own[name][at], np.interp(times, signals.time, own[name]))
        other = theirs[:, i]
        bits &= bool(np.array_equal(mine, other, equal_nan=True))
        digits &= all(_DIGITS % a == _DIGITS % b for a, b in zip(mine, other, strict=True))
        scale = max(float(np.ptp(other)), float(np.abs(other).max()), 1e-12)
        off = float(np.abs(mine - other).max()) / scale
        if not off <= worst:
            worst, where = off, name
    much = f"in {len(names)} columns, {len(theirs)} steps"
    if bits or digits:
        return "equal", f"libcosim: the same {'bits' if bits else 'printed digits'} {much}"
    steps = "" if np.all(there) else ", whose steps differ"
    text = f"libcosim{steps}: within {worst:.2g} of the range {much}"
    return (
        ("equal", text)
        if worst <= (OTHER_STEPS if steps else SAME)
        else ("deviates", f"{text}; the most in {where}")
    )


def _by_element(signals: Signals, outputs: Mapping[str, Sequence[str]]) -> dict[str, np.ndarray]:
    """Return the columns by the names of their elements, as libcosim has them."""
    found: dict[str, np.ndarray] = {}
    for path, names in outputs.items():
        for name in names:
            whole = signals.values_by_name.get(f"{path}.{name.partition('[')[0]}")
            alone = signals.values_by_name.get(f"{path}.{name}")
            if alone is not None:
                found[f"{path}.{name}"] = np.asarray(alone, float)
            elif whole is not None:
                same = [n for n in names if n.partition("[")[0] == name.partition("[")[0]]
                found[f"{path}.{name}"] = np.asarray(whole, float)[:, same.index(name)]
    return found


def _by_libcosim(
    python: str, file: Path, tick: Fraction, times: tuple[float, float],
    outputs: Mapping[str, Sequence[str]],
) -> tuple[np.ndarray, list[str]]:  # fmt: skip
    """Return rows of (time, values), and the names of the values; raise FmuError with a reason."""
    with tempfile.TemporaryDirectory() as scratch:
        out = Path(scratch) / "values"
        given = [str(round(tick * 10**9)), *map(str, times), json.dumps(outputs), str(out)]
        reason = _call(python, file, given)
        if "Invalid algorithm" in reason:  # libcosim asks for it, where OSP's schema does not
            reason = _call(python, _with_algorithm(file, Path(scratch)), given)
        if not out.is_file():
            raise FmuError(str(file), reason, "a system that libcosim runs")
        names = json.loads(Path(f"{out}.json").read_text(encoding="utf-8"))
        return np.fromfile(out).reshape(-1, 1 + len(names)), names


def _call(python: str, file: Path, given: Sequence[str]) -> str:
    """Run the program; return the last line of its error."""
    command = [python, "-c", _PROGRAM, str(file), *given]
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, errors="replace", timeout=TIME_LIMIT,
            check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return f"it did not end within {TIME_LIMIT:g} s"
    except OSError as error:
        return f"{python}: {error.strerror}"
    if done.returncode < 0:
        return f"it crashed with signal {-done.returncode}"
    return (done.stderr.strip().splitlines() or ["no message"])[-1]


def _with_algorithm(file: Path, scratch: Path) -> Path:
    """Write a copy of an OSP file with its default algorithm, among links to what is beside it."""
    for folder, place in ((file.parent.parent, scratch / "copy"),
                          (file.parent, scratch / "copy" / "system")):  # fmt: skip
        place.mkdir()
        for each in folder.iterdir():
            if each not in (file, file.parent):
                (place / each.name).symlink_to(each)
    text = file.read_text(encoding="utf-8")
    copy = scratch / "copy" / "system" / file.name
    copy.write_text(text.replace("<Simulators>", "<Algorithm>fixedStep</Algorithm><Simulators>", 1))
    return copy
