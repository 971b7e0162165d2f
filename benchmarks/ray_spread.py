"""What Ray costs and gives: the same study, and the same trainings, by it and by processes here.

    python benchmarks/ray_spread.py --workers 2

Of each, ratios of wall time measured in one run: two workers of a local Ray cluster beside two
processes (a study by masters) and beside one (a study by a kernel's one thread, trainings one after
the other). The cluster is started before, its workers are warm. Results are compared to the bit.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import uuvsim_cosim as uuv
from uuvsim_cosim.cluster.ray_cluster import Cluster
from uuvsim_cosim.envs.randomisation.distributions import Uniform
from uuvsim_cosim.envs.randomisation.randomisation import Vary
from uuvsim_cosim.learn.training.config import TrainingConfig
from uuvsim_cosim.learn.training.ray_training import ALIKE, train_on
from uuvsim_cosim.learn.training.train import train
from uuvsim_cosim.studies import Study


def seconds(what: Callable[[], object]) -> float:
    began = time.perf_counter()
    what()
    return time.perf_counter() - began


def nothing(_: int) -> None:
    return None


def main() -> None:
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--workers", type=int, default=2)
    asked.add_argument("--runs", type=int, default=64, help="of the study by masters")
    asked.add_argument("--steps", type=int, default=12_800, help="of each training")
    asked.add_argument("--repeats", type=int, default=3)
    given = asked.parse_args()
    workers = given.workers
    connecting = time.perf_counter()
    with (
        tempfile.TemporaryDirectory() as temporary,
        Cluster("local", workers=workers, alike=ALIKE) as cluster,
    ):
        print(f"local cluster of {workers} workers: {time.perf_counter() - connecting:.1f} s")
        place = Path(temporary)
        list(cluster.spread(nothing, range(8 * workers)))
        calls = 200
        each = seconds(lambda: list(cluster.spread(nothing, range(calls)))) / calls
        print(f"a call that does nothing: {1e3 * each:.2f} ms")
        system = uuv.load("bluerov2_hold")

        def study(seeds: int) -> Study:
            return Study(
                system, duration="20", every="0.1", seeds=seeds,
                metrics={"error": "rms(norm(hull.eta[1:3]))"},
                parameters=[Vary("hull.m", Uniform(13.0, 14.0))],
            )  # fmt: skip

        studies = (("master", given.runs, workers), ("kernel", 64 * given.runs, 1))
        for backend, seeds, jobs in studies:
            here, there = [], []
            for k in range(given.repeats + 1):  # the first warms both
                one, two = place / f"{backend}{k}", place / f"{backend}{k}ray"
                asked_for = study(seeds)
                by: Any = {"backend": backend}
                here.append(seconds(partial(asked_for.run, one, jobs=jobs, **by)))
                there.append(seconds(partial(asked_for.run, two, cluster=cluster, **by)))
                same = (one / "runs.parquet").read_bytes() == (two / "runs.parquet").read_bytes()
                assert same, "other bits"
            a, b = statistics.median(here[1:]), statistics.median(there[1:])
            print(
                f"study, {seeds} runs by {backend}: {jobs} here {a:.2f} s, {workers} by Ray "
                f"{b:.2f} s, {a / b:.2f} times as fast; same bits"
            )
        configs = [
            TrainingConfig("source", "sac", seed=s, steps=given.steps) for s in range(workers)
        ]
        a = seconds(lambda: [train(c, folder=place / f"h{c.seed}") for c in configs])
        folders = [place / f"r{c.seed}" for c in configs]
        b = seconds(lambda: train_on(cluster, configs, folders))
        for c, folder in zip(configs, folders, strict=True):
            for name in ("best.npz", "policy.npz", "evaluations.csv", "episodes.csv"):
                one, other = place / f"h{c.seed}" / name, folder / name
                assert one.is_file() == other.is_file()  # no episode may have ended
                assert not one.is_file() or one.read_bytes() == other.read_bytes(), "other bits"
        print(
            f"{workers} trainings of {given.steps} steps: one after the other {a:.1f} s, by Ray "
            f"{b:.1f} s, {a / b:.2f} times as fast; same bits"
        )


if __name__ == "__main__":
    main()
