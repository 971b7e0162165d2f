"""Results of a run of the benchmark: numbers, the learning curve, an episode, policies.

A run writes its results as files, each whole or not at all, so that several runs can work at the
same time and any can be killed. `pack` moves them into an archive, one Parquet file. A file beside
the archive takes precedence over its row there.
"""

from __future__ import annotations

import csv
import io
import json
import os
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim._version import __version__
from uuvsim_cosim.cache import write_whole
from uuvsim_cosim.envs.task.task import TeamTask
from uuvsim_cosim.envs.tasks import scripted
from uuvsim_cosim.envs.tasks.evaluation import evaluate
from uuvsim_cosim.envs.tasks.scripted import scripted_policy
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.shared.task_ids import make_task
from uuvsim_cosim.learn.training.loading import acting_in, load_policies
from uuvsim_cosim.learn.training.training_seeds import JUDGING_SEED

__all__ = [
    "ARCHIVE",
    "Kept",
    "Key",
    "Result",
    "is_kept",
    "keep",
    "kept",
    "keys_of_budget",
    "pack",
    "read_episode",
    "read_result",
    "read_results",
]

ARCHIVE = "results.parquet"
_TEXTS = ("numbers", "curve", "episode")
_ENDINGS = (".json", ".csv", ".episode.csv")


@dataclass(frozen=True, order=True)
class Key:
    """The name of a run."""

    budget: str
    scenario: str
    way: str  # "stt-masac"
    seed: int

    @property
    def stem(self) -> str:
        """The path of its files, without their ending."""
        return f"{self.budget}/{self.scenario}/{self.way}-{self.seed}"


@dataclass(frozen=True)
class Kept:
    """The files of a run, as text."""

    place: str  # of the numbers, for messages
    numbers: str  # JSON
    curve: str | None  # CSV
    episode: str | None  # CSV; of a task of one agent: none


def kept(results: Path, key: Key) -> Kept | None:
    """Return the files of a run, or None; raises InputInvalid if they cannot be read."""
    paths = [results / f"{key.stem}{ending}" for ending in _ENDINGS]
    try:
        if not paths[0].is_file():
            return _archived(results).get(key)
        texts = [p.read_text(encoding="utf-8") if p.is_file() else None for p in paths]
        if not paths[0].is_file():  # packed by another process, which deletes the numbers first
            return _archived(results).get(key)
    except (OSError, ValueError) as error:
        raise InputInvalid(
            paths[0], f"cannot be read ({error})", "a result of `uuvsim reproduce`"
        ) from None
    return Kept(str(paths[0]), texts[0] or "", *texts[1:])


def keys_of_budget(results: Path, budget: str) -> Iterator[Key]:
    """Yield the runs of a budget that have results, in order."""
    found = {key for key in _archived(results) if key.budget == budget}
    yield from sorted(found | set(_loose(results, budget)))


def pack(results: Path) -> Path:
    """Move the files of results into the archive; policies stay as files."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    budgets = [p.name for p in results.iterdir() if p.is_dir()] if results.is_dir() else []
    loose = sorted(key for budget in budgets for key in _loose(results, budget))
    every = dict(_archived(results))
    for key in loose:
        found = kept(results, key)
        assert found is not None
        every[key] = found
    rows = [{**vars(key), **{n: getattr(every[key], n) for n in _TEXTS}} for key in sorted(every)]
    sink = pa.BufferOutputStream()
    schema = pa.schema([
        ("budget", pa.string()), ("scenario", pa.string()), ("way", pa.string()),
        ("seed", pa.int64()), *((n, pa.string()) for n in _TEXTS),
    ])  # fmt: skip
    pq.write_table(pa.Table.from_pylist(rows, schema), sink, compression="zstd")
    path = results / ARCHIVE
    write_whole(path, sink.getvalue().to_pybytes())
    for key in loose:  # in the archive, whole, by now
        for ending in _ENDINGS:
            (results / f"{key.stem}{ending}").unlink(missing_ok=True)
    return path


def _loose(results: Path, budget: str) -> Iterator[Key]:
    for path in sorted((results / budget).glob("*/*.json")):
        way, _, seed = path.stem.rpartition("-")
        if not way or not seed.isdigit():
            raise InputInvalid(path, "no run's name", "WAY-SEED.json")
        yield Key(budget, path.parent.name, way, int(seed))


def _archived(results: Path) -> dict[Key, Kept]:
    path = results / ARCHIVE
    try:
        stat = path.stat()
    except FileNotFoundError:
        return {}
    return _read(path, stat.st_mtime_ns, stat.st_size)


@lru_cache(maxsize=2)
def _read(path: Path, *_: int) -> dict[Key, Kept]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        rows = pq.read_table(os.fspath(path)).to_pylist()
        keys = [Key(r["budget"], r["scenario"], r["way"], r["seed"]) for r in rows]
        texts = [Kept("", *(r[n] for n in _TEXTS)) for r in rows]
    except (OSError, KeyError, pa.ArrowException) as error:
        raise InputInvalid(
            path, f"{type(error).__name__}: {error}", "an archive of `uuvsim reproduce`"
        ) from None
    return {k: replace(t, place=f"{path}: {k.stem}") for k, t in zip(keys, texts, strict=True)}


METRICS = ("track", "dist", "viol", "clean")


@dataclass(frozen=True)
class Result:
    """Results of a run; values by episode are of seeds used for nothing else."""

    key: Key
    about: Mapping[str, Any]  # algorithm, schooling, cpu [s], steps, settings, options
    returns: NDArray[np.float64]  # (episodes,)
    scripted: NDArray[np.float64]  # (episodes,), of the hand-written controller
    metrics: Mapping[str, NDArray[np.float64]]  # (episodes,) each, over the second half
    scripted_metrics: Mapping[str, NDArray[np.float64]]
    curve: Mapping[str, NDArray[np.float64]]  # (evaluations,) each


def is_kept(results: Path, key: Key) -> bool:
    """Return whether the results of a run exist; the numbers are written last."""
    return kept(results, key) is not None


def keep(
    results: Path, key: Key, folder: Path, about: Mapping[str, Any], *, episodes: int = 100
) -> Result:
    """Judge a training's best policy on unused seeds, and write the results.

    The policies are copied for seed 0 only, with the options of the task in which they are judged;
    those of other seeds stay in `folder`.
    """
    task = make_task(about["task"], about["options"])
    policies = load_policies(folder)
    acts = acting_in(task, policies, about["task"])
    teacher = scripted_policy(task)
    judged = evaluate(task, acts, episodes, seed=JUDGING_SEED)
    yardstick = evaluate(task, teacher, episodes, seed=JUDGING_SEED)
    stem = results / key.stem
    stem.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(folder / "evaluations.csv", stem.with_name(f"{stem.name}.csv"))
    one = policies[0].tensors
    if all(
        p.tensors.keys() == one.keys() and all(np.array_equal(p.tensors[k], one[k]) for k in one)
        for p in policies
    ):
        policies = [replace(policies[0], agent="")]  # equal ones are every agent's
    for policy in policies if key.seed == 0 else ():
        name = f"{stem.name}{f'.{policy.agent}' if policy.agent else ''}.npz"
        replace(policy, options=dict(about["options"])).save(stem.with_name(name))
    if isinstance(task, TeamTask) and isinstance(acts, Mapping):
        _write_episode(stem.with_name(f"{stem.name}.episode.csv"), task, acts)
    content = {
        "uuvsim_result": 1,
        "version": __version__,
        **{k: about[k] for k in sorted(about)},
        **{
            name: {
                k: [float(f"{v:.5g}") for v in values]
                for k, values in (("return", e.returns), *((k, e.metrics[k]) for k in METRICS))
            }
            for name, e in (("episodes", judged), ("scripted", yardstick))
        },
    }
    # Last: `is_kept` takes this file as the sign that all others are there.
    write_whole(stem.with_name(f"{stem.name}.json"), (json.dumps(content) + "\n").encode())
    return read_result(results, key)


def read_result(results: Path, key: Key) -> Result:
    """Read the results of a run; raises InputInvalid if they are missing or damaged."""
    found = kept(results, key)
    if found is None:
        raise InputInvalid(
            f"{results / key.stem}.json", "no such file", "a result of `uuvsim reproduce`"
        )
    try:
        read = json.loads(found.numbers)
        if read.pop("uuvsim_result") != 1:
            raise ValueError("of a later version")
        judged, scripted = ({k: np.array(v, float) for k, v in read.pop(name).items()}
                            for name in ("episodes", "scripted"))  # fmt: skip
        returns, yardstick = judged.pop("return"), scripted.pop("return")
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputInvalid(
            found.place, f"{type(error).__name__}: {error}", "a result of `uuvsim reproduce`"
        ) from None
    curve = _columns(found.curve, f"{found.place}: curve")
    return Result(key, read, returns, yardstick, judged, scripted, curve)


def read_results(results: Path, budget: str) -> dict[tuple[str, str], list[Result]]:
    """Read all results of a budget, seeds in order, by scenario and way."""
    found: dict[tuple[str, str], list[Result]] = {}
    for key in keys_of_budget(results, budget):
        found.setdefault((key.scenario, key.way), []).append(read_result(results, key))
    return found


def read_episode(results: Path, key: Key) -> dict[str, NDArray[np.float64]]:
    """Read the saved episode of a team's run, by column."""
    found = kept(results, key)
    return _columns(found.episode if found else None, f"{results / key.stem}: episode")


def _write_episode(path: Path, task: TeamTask, acts: Mapping[str, scripted.Policy]) -> None:
    """Write the first of the judged episodes: the state (5) after each action."""
    from uuvsim_cosim.envs.team_vector import CosimTeamVectorEnv

    env = CosimTeamVectorEnv(task, 1, autoreset_mode="Disabled")
    try:
        seen, _ = env.reset(seed=JUDGING_SEED)
        rows = [env.state()[0]]
        for _ in range(int(task.horizon / task.action_step)):
            actions = np.stack([acts[a](seen[:, i]) for i, a in enumerate(env.agents)], axis=1)
            seen = env.step(actions)[0]
            rows.append(env.state()[0])
    finally:
        env.close()
    N, width = len(env.agents), len(rows[0])
    names = [f"{x}_{i + 1}" for i in range(N) for x in ("x", "y", "theta")]
    names += [f"{x}_{i + 1}" for i in range(N) for x in ("u", "v", "r")] + ["x_T", "y_T"]
    names += [f"{x}_o{k + 1}" for k in range((width - len(names)) // 4) for x in "xyrh"]
    lines = [",".join(["t", *names])]
    dt = float(task.action_step)
    lines += [",".join([f"{k * dt:.1f}", *(f"{v:.4g}" for v in row)]) for k, row in enumerate(rows)]
    write_whole(path, ("\n".join(lines) + "\n").encode())


def _columns(text: str | None, place: str) -> dict[str, NDArray[np.float64]]:
    rows = list(csv.DictReader(io.StringIO(text or "")))
    try:
        return {k: np.array([float(r[k]) for r in rows]) for k in rows[0]}
    except (ValueError, TypeError, IndexError) as error:
        raise InputInvalid(
            place,
            f"{type(error).__name__}: {error}",
            "a whole table, as `uuvsim reproduce` writes it",
        ) from None
