"""Recordings of shipped systems as FMUs, native and fused, of one FMU, and one training."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

import uuvsim_cosim as uuv
from tests.freeze.canary import hash_of
from tests.freeze.moved import resolve

SEED = 3
AS_FMU = "as the FMUs"

# By name: the shipped system, its duration [s], what replaces a component, and start values.
SYSTEMS: dict[str, tuple[str, float, dict[str, str], dict[str, Any]]] = {
    "survey": ("bluerov2_survey", 3.0, {}, {}),
    "task in waves": (
        "bluerov2_task",
        2.0,
        {"current": "model:waves?bottom=true&spreading=10"},
        {"current.h": 25.0, "allocation.tau_d": [8.0, 2.0, 1.0, 0.1, -0.2, 0.5]},
    ),
    "survey in a gridded current": ("bluerov2_survey", 2.0, {"current": "model:current_grid"}, {}),
    "team": (
        "target_tracking",
        6.0,
        {},
        {"tracker_1.pilot.a": 0.4, "tracker_2.pilot.omega": -0.2},
    ),
    "pool": ("pool_tracking", 3.0, {}, {}),
    "mapping with rays": ("seabed_mapping", 2.0, {}, {}),
}


def system_of(name: str) -> tuple[uuv.System, float]:
    """Return one of `SYSTEMS` and its duration [s]."""
    shipped, duration, replaced, values = SYSTEMS[name]
    system = uuv.load(shipped)
    for component, source in replaced.items():
        system = system.replace(component, source)
    for path, value in values.items():
        system = system.set(path, value)
    return system, duration


def recordings(folder: Path) -> dict[str, Any]:
    """Return a line for each signal of each system; other ways to run it only where they differ."""
    return {name: _recorded(name, folder) for name in SYSTEMS} | {"one FMU": _one_fmu(folder)}


def _recorded(name: str, folder: Path) -> dict[str, Any]:
    system, duration = system_of(name)
    runs = {}
    for backend in ("fmu", "native"):
        out = folder / f"{name} {backend}".replace(" ", "_")
        done = uuv.run(system, until=duration, seed=SEED, backend=backend, out=out)
        runs[backend] = done.signals()
    by_fmu = _lines(runs["fmu"])
    native, kernel = _lines(runs["native"]), _lines(_fused(system, runs["native"]))
    return {
        "files": sorted(p.name for p in done.folder.iterdir()),
        "run.json": sorted(json.loads((done.folder / "run.json").read_text())),
        "FMUs": by_fmu,
        "native": AS_FMU if native == by_fmu else native,
        "kernel": AS_FMU if kernel == by_fmu else kernel,
    }


def _fused(system: uuv.System, recorded: uuv.Signals) -> uuv.Signals:
    """Return the signals of a recording as the fused kernel computes them."""
    batch = uuv.fuse(system).batch(2, seeds=[SEED, SEED + 1])
    rows: dict[str, list[np.ndarray]] = {name: [] for name in recorded}
    for k in range(int(recorded.ticks[-1]) + 1):
        if k:
            batch.step()
        if k in recorded.ticks:
            for name, values in rows.items():
                values.append(batch.get(name)[0].copy())
    batch.close()
    values = {
        n: np.array(v).astype(recorded[n].dtype).reshape(recorded[n].shape) for n, v in rows.items()
    }
    return type(recorded)(recorded.time, recorded.ticks, values, recorded.units)


def _one_fmu(folder: Path) -> dict[str, Any]:
    """Return the signals of one hull as FMI 2.0 and FMI 3.0, pushed by a wave of force."""
    build = resolve("uuvsim_cosim.fmus.export", "build_fmu")
    declare = uuv.declare
    found = {}
    for fmi in (2, 3):
        path = build(declare("remus100"), fmi=fmi, target=folder / f"fmi{fmi}" / "remus100.fmu")
        push = [
            "remus100.tau[1]:step,value=20",
            "remus100.tau[6]:chirp,amplitude=2,from=0.1,to=1,until=3",
        ]
        done = uuv.run(path, until=3.0, seed=SEED, out=folder / f"remus100_{fmi}", inputs=push)
        found[f"FMI {fmi}.0"] = _lines(done.signals())
    return found


def _lines(signals: uuv.Signals) -> dict[str, str]:
    """Return for each signal its type, shape and unit, and after a colon the hash of its values."""
    columns = {"time": signals.time, "tick": signals.ticks, **signals}
    return {
        name: f"{v.dtype} {v.shape} {signals.units.get(name, '')}: {hash_of(_bits(v))}"
        for name, v in columns.items()
    }


def _bits(values: np.ndarray) -> bytes:
    """Return the bits, with one bit pattern for all NaN."""
    if values.dtype == object or values.dtype.kind in "US":
        return json.dumps(values.tolist()).encode()
    if values.dtype.kind == "f":
        values = np.where(np.isnan(values), np.nan, values)
    return np.ascontiguousarray(values).tobytes()


TRAINING = (
    "train source --algo sac --seed 1 --envs 4 --steps 480 --evaluate-every 240 "
    "--evaluation-episodes 2 --task-set horizon=4 --set hidden=16 --set batch=16 "
    "--set warm_up=32 --set buffer=200 --no-report --quiet -o"
)


def training(folder: Path) -> dict[str, Any]:
    """Return hashes of a short training's policy, by array, and of its curves, by column."""
    one = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    out = folder / "training"
    command = [sys.executable, "-m", "uuvsim_cosim", *TRAINING.split(), str(out)]
    root = str(Path(uuv.__file__).parents[1])
    done = subprocess.run(
        command,
        env={**os.environ, **one, "PYTHONPATH": root},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    files = [p.name for p in out.iterdir() if "tfevents" not in p.name]
    curves = {}
    for name in ("evaluations", "episodes"):
        header, *rows = (out / f"{name}.csv").read_text().splitlines()
        columns = zip(*(row.split(",") for row in rows), strict=True)
        curves[name] = {
            column: f"{len(rows)} rows: {hash_of(','.join(values).encode())}"
            for column, values in zip(header.split(","), columns, strict=True)
        }
    return {"files": sorted(files), "policy.npz": _arrays(out / "policy.npz"), "curves": curves}


def _arrays(path: Path) -> dict[str, str]:
    with np.load(path) as file:
        return {
            n: f"{file[n].dtype} {file[n].shape}: {hash_of(_bits(file[n]))}" for n in file.files
        }


def without_values(record: Any) -> Any:
    """Return a record of values without the hashes: names, types, shapes, units and rows."""
    if isinstance(record, dict):
        return {name: without_values(value) for name, value in record.items()}
    return record.partition(": ")[0] if isinstance(record, str) else record
