"""The tests that run a mutant: those that execute its line, the fastest and nearest first."""

from __future__ import annotations

import json
import re
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import Any

from operators import Mutant

# Not of use here: they start the whole product, or need programs of other projects.
LEFT_OUT = re.compile(r"tests/(docs|benchmarks|mutation)/|octave|wine|test_(windows|matlab)")
FAR = 3.0  # [s] that a test of another file is put back by, behind the file's own tests

# What executes a line of C is not recorded: this table says which tests run a file.
C_TESTS = {
    "orchestrator/core/": (
        "orchestrator/master/test_core orchestrator/master/test_master "
        "orchestrator/master/test_row_buffer orchestrator/master/test_faults "
        "orchestrator/master/test_iterated orchestrator/master/test_snapshot "
        "orchestrator/plan/test_algebraic_loops orchestrator/python/test_component "
        "orchestrator/master/test_isolation orchestrator/values/test_values "
        "orchestrator/recording/test_recorder orchestrator/running/test_run"
    ),
    "fmus/whole/": ("kernels/system_fmu/test_system_fmu bridge/clients/test_client_fmu"),
    "fmus/guard/": (
        "fmus/isolation/test_guard fmus/isolation/test_isolated orchestrator/master/test_isolation"
    ),
    "fmus/kernels/uuv_float": ("kernels/test_float_math kernels/test_float32"),
    "fmus/kernels/uuv_lane_derivative": ("kernels/derivatives/test_derivatives"),
    "fmus/kernels/float_draws": ("fmus/runtime/test_random kernels/test_float32"),
    "fmus/kernels/cast": ("scene/shared/test_ray_casting"),
    "fmus/kernels/": (
        "kernels/test_lane_functions kernels/test_fuse kernels/test_slower_steps "
        "kernels/batch/test_threads kernels/test_sensors envs/test_vector"
    ),
    "fmus/runtime/fmi/shell": (
        "fmus/export/test_shells fmus/export/test_fmi3_shell fmus/export/test_fmi2_shell "
        "fmus/runtime/test_edges fmus/export/test_exported_exchange fmus/importer/test_fmu3"
    ),
    "fmus/runtime/fmi/fmi2": (
        "fmus/export/test_fmi2_shell fmus/export/test_shells fmus/runtime/test_edges "
        "fmus/importer/test_fmu2 fmus/export/test_exported_exchange"
    ),
    "fmus/runtime/fmi/fmi3": (
        "fmus/export/test_fmi3_shell fmus/export/test_shells fmus/runtime/test_edges "
        "fmus/importer/test_fmu3 fmus/export/test_exported_exchange"
    ),
    "fmus/runtime/worlds/uuv_contact": ("models/hull/test_contact kernels/test_contact"),
    "fmus/runtime/worlds/uuv_touch": ("models/hull/test_contact kernels/test_contact"),
    "fmus/runtime/worlds/uuv_t(ree|errain)": (
        "scene/test_tree scene/shared/test_ray_casting models/hull/test_contact "
        "kernels/test_scene models/sensors/test_range_sensors scene/test_run_warnings"
    ),
    "fmus/runtime/worlds/uuv_(cast|rays)": (
        "scene/shared/test_ray_casting scene/test_tree kernels/test_scene "
        "models/sensors/test_range_sensors"
    ),
    "fmus/runtime/intrinsics/uuv_field": ("models/water/test_current_fields kernels/test_scene"),
    "fmus/runtime/intrinsics/uuv_table": (
        "fmus/runtime/test_table models/intrinsics/test_table kernels/test_torpedo"
    ),
    "fmus/runtime/math/uuv_random": ("fmus/runtime/test_random models/sensors/test_sensor_error"),
    "fmus/runtime/intrinsics/uuv_transformer": (
        "kernels/test_transformer learn/policies/test_runner_sequence"
    ),
    "fmus/runtime/intrinsics/uuv_network": ("kernels/test_network learn/deployment/test_export"),
    "fmus/runtime/": (
        "fmus/runtime/test_math fmus/codegen/test_differential fmus/codegen/test_native "
        "kernels/test_float_math fmus/export/test_shells"
    ),
}


class Lines:
    """Which tests execute which lines, as `run.py --lines` recorded it in a folder."""

    def __init__(self, folder: Path) -> None:
        path = folder / "lines.coverage"
        if not path.is_file():
            raise SystemExit(f"{path}: there is no such file; run with --lines first")
        self._data: Any = import_module("coverage").CoverageData(str(path))
        self._data.read()
        self._durations: dict[str, float] = {}
        for test, seconds in map(json.loads, durations_of(folder).read_text().splitlines()):
            self._durations[test] = max(seconds, self._durations.get(test, 0.0))

    @lru_cache(maxsize=64)  # noqa: B019  (one object for a run)
    def _of(self, path: str) -> dict[int, frozenset[str]]:
        lines = self._data.contexts_by_lineno(path)
        return {n: frozenset(t for c in found if (t := c.rpartition("|")[0]))
                for n, found in lines.items()}  # fmt: skip

    def tests(self, root: Path, mutant: Mutant) -> list[str]:
        """Return the tests that execute a line; if none is known to, those that execute the file.

        A line that runs at the import alone, or in another process alone, has no test of its own.
        """
        lines = self._of(mutant.path)
        found = lines.get(mutant.line) or frozenset[str]().union(*lines.values())
        there = (t for t in found if not LEFT_OUT.search(t) and _is_there(root, t))
        return sorted(there, key=lambda t: self._key(t, mutant))

    def _key(self, test: str, mutant: Mutant) -> tuple[float, str]:
        name = Path(test.partition("::")[0]).stem.removeprefix("test_")
        near = {*name.split("_")} & {*Path(mutant.path).with_suffix("").parts[1:]}
        return self._durations.get(test, 0.0) + FAR * (not near), test


def _is_there(root: Path, test: str) -> bool:
    """Return whether a test still exists; asked for one that does not, pytest runs none."""
    path, _, name = test.partition("::")
    return f"def {name.partition('[')[0].rpartition('::')[2]}(" in _text(root / path)


@lru_cache
def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8") if path.is_file() else ""


def durations_of(folder: Path) -> Path:
    """Return the file with the times of tests."""
    return folder / "durations.jsonl"


def c_tests(mutant: Mutant) -> list[str]:
    """Return the files of tests that run a file of C, the closest first."""
    found = [f"tests/{t}.py" for k, v in C_TESTS.items() for t in v.split()
             if re.match(k, mutant.path)]  # fmt: skip
    words = {*Path(mutant.path).stem.removeprefix("uuv_").split("_")}
    near = lambda test: any(w[:5] in Path(test).stem for w in words if len(w) > 3)  # noqa: E731
    return sorted(dict.fromkeys(found), key=lambda test: not near(test))
