"""Every benchmark runs to its end, with as little work as its options allow."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.scene.s57_cell import slope

FOLDER = Path(__file__).parents[2] / "benchmarks"

# The smallest work that passes through all of a benchmark.
SHORT: dict[str, str] = {
    "bridge/bridge_cost": "--windows 1 --seconds 0.2 --steps 200",
    "bridge/bridge_frames": "--seconds 0.2",
    "bridge/client_fmu": "--count 20",
    "color_camera": "--images 1 --repeats 1",
    "compare_controllers": "--until 6 --controllers pid --cases calm",
    "contact": "",
    "identification/dataflash_index": "",
    "environment_speed": "--repeats 1",
    "growth": "--components 10 20 --vehicles 2 3 --lengths 2 --starts 1 --figure g.svg",
    "identification/coverage": "--seeds 6 --no-contrast",
    "identification/speed": "--seconds 6 --before-seconds 4",
    "imaging_sonar": "--images 1 --repeats 1",
    "installation": "--until 0.1 --components thruster,battery --platforms linux64",
    "isolation_cost": "--steps 200 --repeats 1",
    "kernel_derivatives": "--environments 8 --steps 5 --repeats 1",
    "kernel_speed": "--envs 16 --steps 5 --repeats 1 --lanes 8 --dtypes float64",
    "learners_beside_sb3": "--seeds 1 --steps 2048",
    "learning_speed": "--repeats 1 --hidden 16",
    "identification/log_directions": "",
    "master_cost": "--systems --steps 100 --repeats 1",
    "mujoco_rollout": "--envs 8 --steps 5 --repeats 1",
    "bridge/octave_round_trip": "--count 20",
    "peers": "--steps 100 --repeats 1 --fmus 2",
    "policy_call": "--windows 1",
    "ray_spread": "--workers 1 --runs 2 --steps 128 --repeats 1",
    "rays": "--repeats 1 --rays 20000",
    "readers": "--windows 1 --seconds 0.2 --readers 1",
    "bridge/ros2_latency": "--windows 1 --seconds 0.2",
    "bridge/round_trips": "--count 20",
    "snapshot_cost": "--repeats 5",
    "terrain": "CHART --resolution 50",
    "variable_step": "--until 0.01 --repeats 1",
    "web_page": "bluerov2_hold --seconds 0.02 --repeats 1",
}
# Not in the extra `dev`: without it, the benchmark says what is missing, with status 2.
MISSING = {"mujoco_rollout": ("mujoco", "MuJoCo is missing")}


def test_every_benchmark_has_a_short_form() -> None:
    files = [
        p for folder in ("", "bridge/", "identification/") for p in FOLDER.glob(f"{folder}*.py")
    ]
    assert {p.relative_to(FOLDER).with_suffix("").as_posix() for p in files} == set(SHORT)


@pytest.mark.slow
@pytest.mark.parametrize("name", SHORT)
def test_a_benchmark_runs_to_its_end(name: str, tmp_path: Path) -> None:
    words = SHORT[name].split()
    if "CHART" in words:
        words[words.index("CHART")] = str(slope().write(tmp_path / "XX5SLOPE.000"))
    done = subprocess.run(
        [sys.executable, str(FOLDER / f"{name}.py"), *words],
        cwd=tmp_path, capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": str(FOLDER.parent)},
    )  # fmt: skip
    library, said = MISSING.get(name, ("sys", ""))
    if find_spec(library) is None:
        assert (done.returncode, said in done.stderr) == (2, True), done.stderr
        return
    assert done.returncode == 0, done.stderr
    assert any(c.isdigit() for c in done.stdout), "no figure was printed"
