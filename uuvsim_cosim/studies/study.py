"""Studies: many runs of a system under drawn or gridded parameters, and their metrics."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Literal, final

import numpy as np

from uuvsim_cosim._version import __version__
from uuvsim_cosim.cache import content_hash
from uuvsim_cosim.envs.randomisation.distributions import Choice
from uuvsim_cosim.envs.randomisation.randomisation import Randomisation, Vary
from uuvsim_cosim.envs.randomisation.targets import Places, varies
from uuvsim_cosim.errors import InputInvalid, SystemInvalid, UuvsimError
from uuvsim_cosim.fmus.resources import refuse_unless_it_fits
from uuvsim_cosim.notebook_bar import Progress, shown
from uuvsim_cosim.orchestrator.master.snapshot import plan_hash
from uuvsim_cosim.orchestrator.plan.algebraic_loops import delay_remark, estimated_gain, hops_of
from uuvsim_cosim.orchestrator.ssp.ssd import write_ssd
from uuvsim_cosim.orchestrator.system.elements import Loops, Mismatches
from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.studies.metric import Metric, read_metric
from uuvsim_cosim.studies.result import StudyFolder, StudyResult, result_of
from uuvsim_cosim.studies.run_table import Runs, check_samples, check_seeds
from uuvsim_cosim.studies.simulate_runs import KernelRuns, MasterRuns, Script, Simulated
from uuvsim_cosim.studies.yaml_file import read_study

if TYPE_CHECKING:
    from uuvsim_cosim.cluster.ray_cluster import Cluster

__all__ = ["Study", "StudyInterrupted"]

Backend = Literal["auto", "kernel", "master"]
MEMORY = 192e6  # bytes of sampled signals in a batch
PARTS = 12  # of a study's folder, about


class StudyInterrupted(KeyboardInterrupt):
    """Ctrl-C during a study; finished runs are kept, and the same call continues from there.

    It is a KeyboardInterrupt, so `except Exception` does not catch it. In the example, `progress`
    raises the interrupt in the place of Ctrl-C.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> from uuvsim_cosim.studies import StudyInterrupted
    >>> boat = uuv.System("boat", tick="0.1").add("hull", "model:bluerov2_heavy")
    >>> study = uuv.Study(boat, duration=1, metrics={"depth": "final(hull.eta[3])"}, seeds=16)
    >>> def interrupt(stage, done, total):
    ...     if done == 8:
    ...         raise KeyboardInterrupt
    >>> try:
    ...     study.run("out", jobs=1, batch=8, progress=interrupt)
    ... except StudyInterrupted as error:
    ...     print(error)
    interrupted; 8 of 16 runs are kept in ...out; repeat the command to continue
    >>> study.run("out").resumed
    8
    """


@final
class Study:
    """Study: many runs of a system under drawn or gridded parameters, and metrics of each run.

    The study has one run for each seed at each point of the grid. In a run, `parameters` are drawn:
    a list of `Vary`, or a `Randomisation`. A seed draws the same parameters at every point, and it
    is the seed of the system in its run. `grid` is a list of `Vary` with the distribution
    `Choice`; its points are all combinations of their values. `seeds` is the number of seeds (0, 1,
    …) or a list of them. `metrics` maps names to expressions such as "rms(hull.eta[1])", which
    docs/systems/studies.md describes. They are computed from samples every `every` seconds, by
    default at each communication step, from 0 to `duration`; both are whole numbers of
    communication steps [s]. `name` is by default that of the `system`, and `output`, the folder of
    the results, studies/NAME. Raises InputInvalid or SystemInvalid for arguments that are wrong or
    do not fit the system, before anything runs.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> from uuvsim_cosim.envs import Uniform, Vary
    >>> boat = uuv.System("boat", tick="0.1").add("hull", "model:bluerov2_heavy")
    >>> study = uuv.Study(
    ...     boat.set("hull.tau", [50.0, 0.0, 0.0, 0.0, 0.0, 0.0]),  # N, N.m
    ...     duration=5,
    ...     metrics={"speed": "final(hull.nu[1])"},  # m/s
    ...     parameters=[Vary("hull.m", Uniform(12.5, 14.5))],  # kg
    ...     seeds=8,
    ... )
    >>> result = study.run("out")
    >>> round(result.intervals[0]["mean"], 2)
    0.54
    """

    def __init__(
        self,
        system: System,
        *,
        duration: Fraction | str | float,
        metrics: Mapping[str, str | Metric],
        parameters: Randomisation | Iterable[Vary] = (),
        grid: Iterable[Vary] = (),
        seeds: int | Sequence[int] = 1,
        every: Fraction | str | float | None = None,
        name: str = "",
        output: str | Path | None = None,
    ) -> None:
        self.system = system
        self.name = name or system.name
        self.output = Path(output) if output is not None else Path("studies") / self.name
        tick = system.base_step
        self.duration = Fraction(str(duration))
        self.every = tick if every is None else Fraction(str(every))
        for what, value in (("duration", self.duration), ("every", self.every)):
            if value <= 0 or (value / tick).denominator != 1:
                raise InputInvalid(
                    what,
                    f"{float(value):g} s",
                    f"a whole number of communication steps of {float(tick):g} s",
                )
        self.seeds = check_seeds(seeds)
        drawn = parameters if isinstance(parameters, Randomisation) else Randomisation(parameters)
        self.drawn = drawn.bound(system)
        self.grid = varies(grid, "grid")
        for axis in self.grid:
            if not isinstance(axis.distribution, Choice):
                raise InputInvalid("grid", f"{axis.name} has {axis.distribution!r}", "Choice")
        self._places = Places(system)
        descriptions = {c.path: c.description for c in self._places.plan.components}
        self.metrics = {k: v if isinstance(v, Metric) else Metric(v) for k, v in metrics.items()}
        if not self.metrics:
            raise InputInvalid("metrics", "none", "at least one, such as final(hull.eta)")
        read = tuple(read_metric(k, v, descriptions) for k, v in self.metrics.items())
        steps = int(self.duration / tick)
        self.script = Script(system, steps, int(self.every / tick), read)
        check_samples(int(self.duration / self.every) + 1, self._width)
        for label, m in self.metrics.items():
            end = self.duration if m.until is None else m.until
            if not 0 <= m.after < end <= self.duration:
                raise InputInvalid(
                    f"metrics.{label}",
                    f"from {float(m.after):g} to {float(end):g} s",
                    f"a window within 0 to {float(self.duration):g} s",
                )
        self.runs = Runs(self.drawn, self.grid, self.seeds, self._places)
        _ = self.runs.start  # refuses impossible bodies now, before anything runs
        twice = [c for c in self.metrics if c in self.runs.columns()]
        if twice:
            raise InputInvalid("metrics", f"{twice[0]!r} names a parameter too", "a new name")

    @classmethod
    def read(
        cls, path: str | Path, loops: Loops | None = None, mismatches: Mismatches | None = None
    ) -> Study:
        """Read the study in a YAML file.

        `path` is the file, and `loops` ("iterate", "delay" or "refuse") the policy for algebraic
        loops instead of that of the file. `mismatches` ("refuse" or "warn") is the policy for parts
        of another vehicle instead of that of the system (see `System.with_mismatches`). Raises
        InputInvalid with every mistake and its line.

        Example:

        >>> from pathlib import Path
        >>> import uuvsim_cosim as uuv
        >>> text = "{system: bluerov2_hold, duration: 2, metrics: {depth: 'mean(hull.eta[3])'}}"
        >>> _ = Path("depth.yaml").write_text(text)
        >>> study = uuv.Study.read("depth.yaml")
        >>> study.duration, study.output
        (Fraction(2, 1), PosixPath('studies/depth'))
        """
        options = read_study(Path(path), loops, mismatches)
        try:
            return cls(**options)
        except UuvsimError as error:
            raise InputInvalid(f"{path}: {error}") from None

    def run(
        self,
        out: str | Path | None = None,
        *,
        jobs: int | None = None,
        restart: bool = False,
        backend: Backend = "auto",
        batch: int | None = None,
        progress: Progress | Literal[False] | None = None,
        cluster: Cluster | None = None,
    ) -> StudyResult:
        """Run the study into the folder `out`, by default `output`; return its result.

        Runs that an earlier call has finished there are not repeated; with `restart`, the folder is
        cleared first. With `backend` "auto", a fused kernel makes `batch` runs at once in `jobs`
        threads; if the system cannot be fused, masters make them in `jobs` processes. "kernel" and
        "master" require one of them. With a `cluster`, its workers make the runs. The results have
        the same bits in all cases. `progress(stage, done, total)` is called after each batch;
        without it, a notebook shows a bar, with False it does not.

        Raises StudyInterrupted on Ctrl-C, after which the same call continues; InputInvalid for a
        folder of another study; and SystemInvalid if "kernel" is required and impossible. A run
        whose component fails does not end the study: its row has the message in "failure".
        """
        jobs = (os.cpu_count() or 1) if jobs is None else jobs
        if jobs < 1 or (batch is not None and batch < 1):
            raise InputInvalid(f"jobs {jobs}, batch {batch}", "at least 1")
        run_bytes = 8 * (self.script.steps // self.script.every + 2) * max(self._width, 1)
        at_once = min(batch or 8, self.runs.n)
        refuse_unless_it_fits(
            "every",
            f"the samples of {at_once} runs",
            run_bytes * at_once,
            "samples that are {times} times as far apart, or a shorter duration",
        )
        path = Path(out) if out is not None else self.output
        folder = StudyFolder(path, self.asked, restart, self.sources)
        write_ssd(self.system, folder.path / "system.ssd")
        began = time.perf_counter()
        done = folder.done()
        remaining = [r for r in range(self.runs.n) if r not in done]
        remarks = [*self.runs.sinking, *self.drawn.remarks]
        used = ""
        if remaining:
            with shown(progress) as report:
                if report is not None:
                    report("building", 0, 1)
                parts = PARTS if cluster is None else max(PARTS, 4 * cluster.cpus)
                most = min(max(8, int(MEMORY / run_bytes) // 8 * 8), 512)
                size = batch or min(most, max(8, 8 * math.ceil(len(remaining) / parts / 8)))
                simulated, used, why = self._simulated(backend, jobs, len(remaining), size, cluster)
                remarks += [why] if why else []
                try:
                    most = size
                    if used == "master":
                        most = batch or max(1, min(16, len(remaining) // (4 * len(simulated))))
                    self._run(simulated, remaining, folder, most, report)
                except KeyboardInterrupt:
                    count = len(folder.done())
                    raise StudyInterrupted(
                        f"interrupted; {count} of {self.runs.n} runs are kept in {folder.path}; "
                        "repeat the command to continue"
                    ) from None
                finally:
                    for each in simulated:
                        each.close()
        plan = self._places.plan
        remarks += plan.warnings
        for loop in plan.algebraic_loops:  # delayed ones that diverge, by their gain at the start
            if not (loop.iterated or loop.undeclared):
                remarks.append(delay_remark(hops_of(plan, loop), estimated_gain(plan, loop)))
        return result_of(
            folder, self.runs, self.script, [r for r in dict.fromkeys(remarks) if r],
            name=self.name, backend=used, resumed=len(done), wall_time=time.perf_counter() - began,
        )  # fmt: skip

    @property
    def asked(self) -> dict[str, object]:
        """The settings that identify the study; a folder of a study with others is refused.

        Example:

        >>> import uuvsim_cosim as uuv
        >>> boat = uuv.System("boat", tick="0.1").add("hull", "model:bluerov2_heavy")
        >>> study = uuv.Study(boat, duration=1, metrics={"depth": "final(hull.eta[3])"}, seeds=2)
        >>> study.asked["duration"], study.asked["seeds"]
        ('1', [0, 1])
        """
        plan = self._places.plan
        start = [
            f"{c.path} {v.name} {np.asarray(c.start.get(v.name, v.start)).tolist()!r}"
            for c in plan.components
            for v in c.description.of("parameter", "structuralParameter", "input")
        ]
        files = [Path(c.source.rpartition(":")[0] or c.source) for c in plan.components]
        own = [f.read_bytes() for f in files if f.suffix == ".py" and f.is_file()]
        return {
            "system": self.system.name,
            "version of the system": content_hash([plan_hash(plan), *start, *own]),
            "duration": str(self.duration),
            "every": str(self.every),
            "metrics": {
                k: [m.expression, str(m.after), None if m.until is None else str(m.until)]
                for k, m in self.metrics.items()
            },
            "parameters": [repr(v) for v in self.drawn.parameters],
            "correlation": [[*k, v] for k, v in self.drawn.correlation.items()],
            "grid": [repr(v) for v in self.grid],
            "seeds": list(self.seeds),
            "uuvsim-cosim": __version__,
        }

    @property
    def sources(self) -> tuple[tuple[str, str], ...]:
        """The publications of the intervals that the study draws from, as (file, text).

        Example:

        >>> import uuvsim_cosim as uuv
        >>> from uuvsim_cosim.envs import published
        >>> boat = uuv.System("boat", tick="0.1").add("hull", "model:bluerov2_heavy")
        >>> drawn = published("bluerov2_heavy")
        >>> metrics = {"depth": "final(hull.eta[3])"}
        >>> uuv.Study(boat, duration=1, metrics=metrics, parameters=drawn).sources[0]
        ('models/vehicles/bluerov2_heavy/published.yaml', 'von Benzon et al. (2022), Table A1')
        """
        drawn = (*self.drawn.parameters, *self.grid)
        return tuple(dict.fromkeys(source for vary in drawn for source in vary.sources))

    # ---- inside ---------------------------------------------------------------------------

    @property
    def _width(self) -> int:
        """The number of signals' elements that metrics read in each sample."""
        return sum(self._places.variables[s].size for s in self.script.signals)

    def _simulated(
        self, backend: Backend, jobs: int, n: int, size: int, cluster: Cluster | None
    ) -> tuple[list[Simulated], str, str]:
        """Return the simulators, their name, and the reason if they are not a kernel."""
        why = ""
        if backend != "master":
            try:
                kernel = KernelRuns(self.script, min(size, n), jobs)
            except SystemInvalid as error:
                if backend == "kernel":
                    raise
                why = f"run by masters, since it cannot be fused: {error.problems[0]}"
            else:
                if cluster is None:
                    return [kernel], "kernel", ""
                kernel.close()
        if cluster is not None:
            from uuvsim_cosim.studies.worker import ray_runs

            used: Literal["kernel", "master"] = "master" if why or backend == "master" else "kernel"
            places = n if used == "master" else min(size, n)
            return ray_runs(cluster, self.script, used, places), used, why
        if min(jobs, n) == 1:
            return [MasterRuns(self.script)], "master", why
        from uuvsim_cosim.orchestrator.master.master import Master
        from uuvsim_cosim.orchestrator.master.prepared import prepare
        from uuvsim_cosim.studies.worker import ProcessRuns

        plan = self._places.plan
        Master(plan, prepare(plan, "native")).free()  # compile once here, not in every process
        made: list[Simulated] = []
        try:
            while len(made) < min(jobs, n):
                made.append(ProcessRuns(self.script))
        except BaseException:
            for each in made:
                each.close()
            raise
        return made, "master", why

    def _run(
        self, simulated: list[Simulated], remaining: list[int], folder: StudyFolder, most: int,
        progress: Progress | None,
    ) -> None:  # fmt: skip
        from uuvsim_cosim.share import share

        chunks = [remaining[i : i + most] for i in range(0, len(remaining), most)]
        count = self.runs.n - len(remaining)
        start = self.runs.start

        def work(each: Simulated, chunk: list[int]) -> list[int]:
            rows = {k: v[chunk] for k, v in start.items()}
            folder.keep(chunk, each.runs([self.runs.seed(r) for r in chunk], rows))
            return chunk

        if progress is not None:
            progress("running", count, self.runs.n)
        for chunk in share(work, simulated, chunks):
            count += len(chunk)
            if progress is not None:
                progress("running", count, self.runs.n)
