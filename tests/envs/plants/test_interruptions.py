"""After any exception inside a call, a reset works and gives the bits of fresh environments."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.envs.drift import Drift
from uuvsim_cosim.envs import CosimVectorEnv
from uuvsim_cosim.envs.plants import worker_process
from uuvsim_cosim.envs.plants.worker_process import WorkerProcess
from uuvsim_cosim.errors import InputInvalid, UuvsimError

N = 4
KINDS: dict[str, dict[str, Any]] = {
    "threads": {"backend": "kernel", "threads": 3, "num_envs": 64},
    "master": {"backend": "master", "processes": 0},
    "processes": {"backend": "master", "processes": 2},
}


def lived(env: CosimVectorEnv) -> np.ndarray:
    shape = env.action_space.shape
    assert shape is not None
    first = env.reset(seed=0)[0]
    return np.array([first, *(env.step(np.full(shape, np.sin(k)))[0] for k in range(5))])


@pytest.mark.parametrize("kind", KINDS)
def test_after_a_signal_a_reset_gives_the_bits_of_fresh_environments(kind: str) -> None:
    env = CosimVectorEnv(Drift(), **{"num_envs": N, **KINDS[kind]})
    expected = lived(env)
    old = signal.signal(signal.SIGALRM, signal.default_int_handler)
    try:
        for trial in range(12):
            env.reset(seed=0)
            with pytest.raises(KeyboardInterrupt):
                _step_until_a_signal(env, 0.002 + 0.0003 * trial)
            np.testing.assert_array_equal(lived(env), expected)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, old)
    env.close()


def _step_until_a_signal(env: CosimVectorEnv, seconds: float) -> None:
    signal.setitimer(signal.ITIMER_REAL, seconds)  # on a loaded machine before the first step
    while True:
        env.step(np.zeros(env.action_space.shape or ()))


class Stop(Exception):
    """What a signal handler raises."""


@pytest.mark.parametrize("place", ["send", "answer", "_next", "receive"])
@pytest.mark.parametrize("after", [False, True])
def test_wherever_an_exchange_is_interrupted_a_reset_settles_it(
    monkeypatch: pytest.MonkeyPatch, place: str, after: bool
) -> None:
    env = CosimVectorEnv(Drift(), N, backend="master", processes=2)
    expected = lived(env)
    owner: Any = worker_process if place == "receive" else WorkerProcess
    own: Callable[..., Any] = getattr(owner, place)

    def interrupted(*arguments: Any) -> Any:
        if after:
            own(*arguments)
        raise Stop

    with monkeypatch.context() as patch:
        patch.setattr(owner, place, interrupted)
        with pytest.raises(Stop):
            env.step(np.zeros((N, 3)))
    with pytest.raises(InputInvalid, match=r"was interrupted; expected reset\(\)|no episode"):
        env.step(np.zeros((N, 3)))
    np.testing.assert_array_equal(lived(env), expected)
    env.close()


def test_a_worker_torn_in_a_message_is_made_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    env = CosimVectorEnv(Drift(), N, backend="master", processes=2)
    expected = lived(env)
    plant: Any = env._simulation.episodes.plant  # type: ignore[union-attr]

    def half(pipe: Any, message: Any) -> None:
        pipe.write(b"\x40\0\0\0")
        raise Stop

    with monkeypatch.context() as patch:
        patch.setattr("uuvsim_cosim.envs.plants.worker_process.send", half)
        with pytest.raises(Stop):
            env.step(np.zeros((N, 3)))
    assert plant._workers[0].torn
    with pytest.raises(UuvsimError, match="was interrupted"):
        plant.step(1)
    np.testing.assert_array_equal(lived(env), expected)
    env.close()


@pytest.mark.parametrize("threads", [1, 2])
def test_a_forked_process_steps_a_kernel_with_threads_of_its_own(threads: int) -> None:
    script = (
        "import os, signal, numpy as np\n"
        "from tests.envs.drift import Drift\n"
        "from uuvsim_cosim.envs import CosimVectorEnv\n"
        f"env = CosimVectorEnv(Drift(), 64, threads={threads})\n"
        "env.reset(seed=0); env.step(np.zeros((64, 3)))\n"
        "if os.fork() == 0:\n"
        "    signal.alarm(120)\n"
        "    seen = env.step(np.ones((64, 3)))[0]\n"
        "    os._exit(0 if np.isfinite(seen).all() else 1)\n"
        "print(os.waitstatus_to_exitcode(os.wait()[1]))\n"
    )
    assert _run(script) == "0"


def test_a_forked_process_has_no_workers_and_leaves_them_alone() -> None:
    script = (
        "import os, signal, numpy as np\n"
        "from tests.envs.drift import Drift\n"
        "from uuvsim_cosim.envs import CosimVectorEnv\n"
        "env = CosimVectorEnv(Drift(), 4, backend='master', processes=2)\n"
        "env.reset(seed=0)\n"
        "if os.fork() == 0:\n"
        "    signal.alarm(120)\n"
        "    try:\n"
        "        env.step(np.ones((4, 3)))\n"
        "    except Exception as error:\n"
        "        env.close()\n"
        "        os._exit('expected new environments' not in str(error))\n"
        "    os._exit(2)\n"
        "code = os.waitstatus_to_exitcode(os.wait()[1])\n"
        "env.step(np.ones((4, 3))); env.close(); print(code)\n"
    )
    assert _run(script) == "0"


def test_shared_memory_has_no_name_from_the_start() -> None:
    from uuvsim_cosim.envs.plants.worker_process import Shared

    def named() -> set[str]:
        return {f for f in os.listdir("/dev/shm") if f.startswith(f"uuvsim-{os.getpid()}-")}

    before = named()
    memory = Shared(None, 3, 2, 10)
    other = Shared(os.dup(memory.key), 3, 2, 10)  # type: ignore[arg-type]
    assert named() == before
    memory.signals[2, 9] = 7.0
    assert other.signals[2, 9] == 7.0
    memory.release()
    other.release()


def _run(script: str) -> str:
    done = subprocess.run(
        [sys.executable, "-W", "ignore::DeprecationWarning", "-c", script],
        capture_output=True, text=True, check=True, cwd=Path(__file__).parents[3],
    )  # fmt: skip
    return done.stdout.strip()
