from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.envs.drift import drifting
from uuvsim_cosim.envs.plants.choice import plant_of
from uuvsim_cosim.envs.plants.plant import Plant
from uuvsim_cosim.errors import InputInvalid, SystemInvalid, UuvsimError
from uuvsim_cosim.orchestrator.system.system import System

READS = ("hull.eta", "current.v_c", "hull.m")
ACTS = [("hull.tau", 5), ("hull.tau", 0)]


def plant(n: int, **options: Any) -> Plant:
    return plant_of(drifting(), n, reads=READS, acts=ACTS, **options)


def run(made: Plant, seeds: list[int]) -> list[np.ndarray]:
    """Two episodes, with another mass in the first, and a partial reset."""
    n = made.n
    every = np.ones(n, bool)
    made.reset(every, seeds, {"hull.m": np.linspace(11.0, 14.0, n)})
    seen = [made.gather()]
    for k in range(3):
        made.scatter(np.stack([np.full(n, 0.5 * k), np.arange(n, dtype=float)]))
        made.step(2)
        seen.append(made.gather())
    odd = np.arange(n) % 2 == 1
    made.reset(odd, [s + 100 for s in seeds], {})
    made.step(3)
    seen.append(made.gather())
    assert not made.failed.any()
    return seen


def test_kernel_masters_and_processes_give_the_same_bits() -> None:
    runs = []
    for options in (
        {"backend": "kernel"},
        {"backend": "kernel", "threads": 2},
        {"backend": "master", "processes": 0},
        {"backend": "master", "processes": 2},
    ):
        made = plant(11, **options)
        runs.append(run(made, list(range(11))))
        made.close()
        made.close()
    for other in runs[1:]:
        for a, b in zip(runs[0], other, strict=True):
            np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("options", [{"backend": "kernel"}, {"backend": "master"}])
def test_one_copy_equals_its_row_among_many(options: dict[str, Any]) -> None:
    many, one = plant(9, processes=0, **options), plant(1, **options)
    every = np.ones(9, bool)
    many.reset(every, list(range(9)), {})
    one.reset(every[:1], [6], {})
    for made in (many, one):
        made.scatter(np.ones((2, made.n)))
        made.step(5)
    np.testing.assert_array_equal(many.gather()[:, 6:7], one.gather())
    many.close()
    one.close()


@pytest.mark.parametrize("backend", ["kernel", "master"])
def test_a_start_value_holds_for_one_episode(backend: Any) -> None:
    made = plant(2, backend=backend, processes=0)
    made.reset(np.ones(2, bool), [1, 2], {"hull.m": np.array([12.0, 13.0])})
    np.testing.assert_array_equal(made.gather()[-1], [12.0, 13.0])
    declared = drifting().describe("hull").variables["m"].start
    made.reset(np.array([True, False]), [1, 2], {})
    np.testing.assert_array_equal(made.gather()[-1], [declared, 13.0])
    made.close()


@pytest.mark.parametrize("backend", ["kernel", "master"])
def test_inputs_have_their_start_values_again_after_a_reset(backend: Any) -> None:
    made = plant_of(drifting(), 1, reads=["hull.tau"], acts=ACTS, backend=backend)
    made.reset(np.ones(1, bool), [1], {})
    made.scatter(np.ones((2, 1)))
    made.step(1)
    np.testing.assert_array_equal(made.gather().T, [[1, 0, 0, 0, 0, 1]])
    made.reset(np.ones(1, bool), [1], {})
    made.step(1)
    np.testing.assert_array_equal(made.gather(), np.zeros((6, 1)))
    made.close()


def test_what_cannot_be_fused_gets_masters(first_order_fmi3: Path) -> None:
    system = System("lag", "0.1").add("lag", str(first_order_fmi3))
    with pytest.raises(SystemInvalid, match="an FMU"):
        plant_of(system, 1, reads=["lag.y"], acts=[("lag.u", 0)], backend="kernel")
    made = plant_of(system, 1, reads=["lag.y"], acts=[("lag.u", 0)])
    assert type(made).__name__ == "MasterPlant"
    made.close()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"backend": "fast"}, "backend 'fast'.*'auto', 'kernel' or 'master'"),
        ({"dtype": "float16"}, "dtype 'float16'.*'float64' or 'float32'"),
        ({"backend": "master", "dtype": "float32"}, "expected backend 'kernel'"),
        ({"backend": "master", "processes": -1}, "processes -1; expected a whole number from 0"),
    ],
)
def test_a_wrong_option_is_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(InputInvalid, match=words):
        plant(2, **options)


def test_a_worker_that_is_killed_is_a_sentence() -> None:
    made = plant(4, backend="master", processes=2)
    made.reset(np.ones(4, bool), [1, 2, 3, 4], {})
    process = made._workers[1]._process  # type: ignore[attr-defined]
    os.kill(process.pid, signal.SIGKILL)
    with pytest.raises(UuvsimError, match=r"environments 2 to 3 ended by signal 9"):
        made.step(1)
    with pytest.raises(UuvsimError, match="expected new environments"):
        made.step(1)
    made.close()


def test_workers_end_when_the_parent_is_killed(tmp_path: Path) -> None:
    script = (
        "import sys, time\n"
        "from tests.envs.plants.test_plants import plant\n"
        "made = plant(2, backend='master', processes=2)\n"
        "print(*(w._process.pid for w in made._workers), flush=True)\n"
        "time.sleep(60)\n"
    )
    root = Path(__file__).parents[3]
    with subprocess.Popen(
        [sys.executable, "-c", script], stdout=subprocess.PIPE, text=True, cwd=root
    ) as parent:
        assert parent.stdout is not None
        pids = [int(p) for p in parent.stdout.readline().split()]
        parent.kill()
    assert len(pids) == 2
    waits = [os.pidfd_open(pid) if _alive(pid) else None for pid in pids]
    import select

    for handle in waits:
        if handle is not None:
            assert select.select([handle], [], [], 120)[0], "the worker goes on"
            os.close(handle)


def test_an_error_in_a_worker_has_its_class_and_words() -> None:
    made = plant(2, backend="master", processes=2)
    made.reset(np.ones(2, bool), [1, 2], {"hull.m": np.array([12.0, -1.0])})
    assert made.failed.tolist() == [False, True]
    assert "value -1.0" in str(made.failure(1))
    with pytest.raises(UuvsimError, match="mm"):
        made.reset(np.ones(2, bool), [1, 2], {"hull.mm": np.zeros(2)})
    made.reset(np.ones(2, bool), [1, 2], {})
    made.step(1)
    assert not made.failed.any()
    made.close()


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_a_python_component_runs_in_processes_and_fails_by_name(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(
        "class Sum:\n"
        "    inputs = {'u': None}\n"
        "    outputs = {'y': None}\n"
        "    def __init__(self):\n"
        "        self.y = 0.0\n"
        "    def step(self, t, dt, u):\n"
        "        print('noise')\n"
        "        if u['u'] > 5:\n"
        "            raise ValueError('too much')\n"
        "        self.y += u['u'] * dt\n"
        "        return {'y': self.y}\n"
    )
    system = System("python", "0.5").add("sum", f"{file}:Sum")
    made = plant_of(system, 3, reads=["sum.y"], acts=[("sum.u", 0)], processes=2)
    made.reset(np.ones(3, bool), [1, 2, 3], {})
    made.scatter(np.array([[1.0, 9.0, 3.0]]))
    made.step(2)
    np.testing.assert_array_equal(made.gather()[0, [0, 2]], [1.0, 3.0])
    assert made.failed.tolist() == [False, True, False]
    assert "'sum' failed" in str(made.failure(1))
    assert "too much" in str(made.failure(1))
    made.reset(made.failed, [1, 2, 3], {})
    made.scatter(np.array([[1.0, 2.0, 3.0]]))
    made.step(2)
    np.testing.assert_array_equal(made.gather(), [[2.0, 2.0, 6.0]])
    made.close()
