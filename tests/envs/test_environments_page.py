"""What docs/learning/environments.md and teams.md show does what the pages say."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from uuvsim_cosim.envs import CosimEnv, CosimVectorEnv, FunctionTask
from uuvsim_cosim.envs.task.task import Channel
from uuvsim_cosim.orchestrator.system.system import System

PAGES = Path(__file__).parents[2] / "docs" / "learning"


def block(page: str, note: str) -> str:
    text = (PAGES / page).read_text(encoding="utf-8")
    found = re.search(rf"<!-- {note} -->\n```python\n(.*?)^```$", text, re.M | re.S)
    assert found is not None
    return found[1]


def test_the_team_of_ones_own_vehicles_runs() -> None:
    names: dict[str, Any] = {"__name__": "page"}
    exec(block("teams.md", "run"), names)
    assert names["truncated"] == {"red": True, "blue": True}
    assert names["rewards"]["red"] > names["rewards"]["blue"] > 0
    assert names["observations"]["blue"][1] > names["observations"]["red"][1] == 0


def test_a_python_component_draws_from_the_seed_that_the_master_gives(tmp_path: Path) -> None:
    (tmp_path / "noisy.py").write_text(block("environments.md", "file: noisy.py"))
    task = FunctionTask(
        System("noisy", "0.1").add("noisy", f"{tmp_path / 'noisy.py'}:Noisy"),
        actions=[Channel("noisy.x", -1, 1)],
        observations=["noisy.y"],
        reward=lambda m: m["noisy.y"],
        action_step="0.1",
        horizon=1,
    )
    one, many = CosimEnv(task), CosimVectorEnv(task, 3, processes=0)

    def lived(env: Any, shape: Any, seed: int) -> Any:
        env.reset(seed=seed)
        return np.array([env.step(np.zeros(shape))[0] for _ in range(5)])

    first = lived(one, 1, 4)
    np.testing.assert_array_equal(lived(one, 1, 4), first)
    assert not np.array_equal(lived(one, 1, 5), first)
    seen = lived(many, (3, 1), 3)
    np.testing.assert_array_equal(seen[:, 1], first)
    assert len(np.unique(seen[:, :, 0])) == 15
    one.close()
    many.close()
