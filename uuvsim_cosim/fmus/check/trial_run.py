"""Trial run of an FMU by this package's importer, as a process that `check_fmu` starts."""

from __future__ import annotations

import json
import os
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from uuvsim_cosim.errors import ComponentFailed, FmuError
from uuvsim_cosim.fmus.check.reference_result import (
    TOLERANCE,
    default_experiment,
    deviations,
    references,
)
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.importer.input_csv import Series, apply_series, read_input_csv
from uuvsim_cosim.fmus.importer.read_description import FmuArchive, read_fmu
from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_fmu

__all__ = ["LOOKS", "trial"]

STEPS = 500  # at most, of the run
REPEATED = 50  # at most, of each run that is repeated
DEFAULT_STEP, DEFAULT_STOP = 0.01, 1.0  # [s] if the FMU has none

Entry = dict[str, str]
Rows = list[dict[str, np.ndarray]]  # the outputs at each communication point


class NotApplicable(Exception):
    """The reason why a look is not made at this FMU."""


def trial(
    path: Path, looks: Iterable[str] = (), report: Callable[[Entry], None] = lambda entry: None
) -> list[Entry]:
    """Make the named looks, all by default; return the findings, and report each result."""
    experiment = _Experiment(read_fmu(path))
    findings: list[Entry] = []
    looks = list(looks or LOOKS)
    if "run" not in looks:
        list(run(experiment))  # to find out how many steps the FMU makes
    for name in looks:
        report({"check": name, "result": "begun", "text": ""})
        try:
            experiment.summary = ""
            texts = list(LOOKS[name](experiment))
            found = [{"check": name, "result": "finding", "text": text} for text in texts]
            done = found or [{"check": name, "result": "ok", "text": experiment.summary}]
        except NotApplicable as reason:
            found, done = [], [{"check": name, "result": "not applicable", "text": str(reason)}]
        except Exception as error:  # of any kind: it is a finding
            found = done = [{"check": name, "result": "finding", "text": str(error)}]
        for entry in done:
            report(entry)
        findings += [{"check": e["check"], "text": e["text"]} for e in found]
        if name == "run" and any(e["result"] == "finding" for e in done) and not experiment.ran:
            break
    return findings


class _Experiment:
    """The FMU's default experiment, with the inputs of its own reference result if it has one."""

    def __init__(self, fmu: FmuArchive) -> None:
        self.fmu = fmu
        self.outputs = fmu.description.of("output")
        self.summary = ""  # the text of the look if it is ok
        self.ran = False
        self.begin, stop, step = default_experiment(fmu)
        span = DEFAULT_STOP if stop is None or stop <= self.begin else stop - self.begin
        self.h = step or min(DEFAULT_STEP, span / 10)
        self.count = max(2, min(STEPS, round(span / self.h)))
        self.repeated = min(self.count, REPEATED)
        self.series: list[Series] = []
        try:
            given = next((r.inputs for r in references(fmu) if r.inputs is not None), None)
            if given is not None:
                self.series = read_input_csv(given, fmu.description)
        except Exception:
            self.series = []  # the look at the reference reports the error

    @contextmanager
    def instance(self, name: str = "trial") -> Iterator[Component]:
        """Yield an instance, and free it afterwards."""
        x = instantiate_fmu(self.fmu, name)
        try:
            yield x
        finally:
            x.free()

    def start(self, x: Component) -> None:
        """Go through Initialization Mode."""
        x.enter_initialization_mode(self.begin, None)
        self.feed(x, 0)
        x.exit_initialization_mode()

    def time(self, k: int) -> float:
        """Return communication point k [s]."""
        return self.begin + k * self.h

    def feed(self, x: Component, k: int) -> None:
        """Set the inputs of a step."""
        apply_series(x, self.series, self.time(k))

    def step(self, x: Component, first: int, n: int) -> Rows:
        """Make steps; return the outputs after each."""
        rows: Rows = []
        for k in range(first, first + n):
            self.feed(x, k)
            x.do_step(self.time(k), self.h)
            rows.append(self.read(x))
        return rows

    def read(self, x: Component) -> dict[str, np.ndarray]:
        """Read all outputs."""
        return {v.name: np.asarray(x.get(v)).copy() for v in self.outputs}

    def differences(self, one: Rows, other: Rows, what: str, first: int = 0) -> Iterator[str]:
        """Yield a text for each output that is not bit-identical, with the time of the first."""
        for v in self.outputs:
            for k, rows in enumerate(zip(one, other, strict=True)):
                a, b = (row[v.name] for row in rows)
                texts = object in (a.dtype, b.dtype)
                if not (np.array_equal(a, b) if texts else a.tobytes() == b.tobytes()):
                    t = self.time(first + k + 1)
                    yield f"output {v.name!r} differs {what}, first at t = {t:.9g} s"
                    break


def run(e: _Experiment) -> Iterator[str]:
    """Simulate the default experiment with the start values."""
    with e.instance() as x:
        e.start(x)
        seen: set[str] = set()
        end = ""
        for k in range(e.count):
            try:
                values = e.step(x, k, 1)[0]
            except ComponentFailed as error:
                if k == 0 or not error.asks_to_end:
                    raise
                end = ", then it asked to end the simulation"
                e.count, e.repeated = k, min(k, e.repeated)
                break
            for name, value in values.items():
                bad = value.dtype.kind == "f" and not np.isfinite(value).all()
                if bad and name not in seen:
                    seen.add(name)
                    yield f"output {name!r} is not finite from t = {e.time(k + 1):.9g} s on"
        e.ran = True
        if not end:
            x.terminate()
    e.summary = f"{e.count} steps of {e.h:g} s{end}"


def determinism(e: _Experiment) -> Iterator[str]:
    """Step two instances in turn, or one after the other if only one may exist at a time."""
    n = e.repeated
    rows: tuple[Rows, Rows] = ([], [])
    if e.fmu.description.can_be_instantiated_only_once:
        for r in rows:
            with e.instance() as x:
                e.start(x)
                r += e.step(x, 0, n)
        e.summary = f"two instances, one after the other: the same bits over {n} steps"
        yield from e.differences(*rows, "between two instances, one after the other")
        return
    with e.instance("first") as a, e.instance("second") as b:
        for x in (a, b):
            e.start(x)
        for k in range(n):
            for x, r in zip((a, b), rows, strict=True):
                r += e.step(x, k, 1)
    e.summary = f"two instances side by side: the same bits over {n} steps"
    yield from e.differences(*rows, "between two instances side by side")


def reset(e: _Experiment) -> Iterator[str]:
    """Reset, and run again."""
    with e.instance() as x:
        e.start(x)
        first = e.step(x, 0, e.repeated)
        x.reset()
        e.start(x)
        again = e.step(x, 0, e.repeated)
    e.summary = f"run again: the same bits over {e.repeated} steps"
    yield from e.differences(first, again, "after a reset")


def state(e: _Experiment) -> Iterator[str]:
    """Restore states: of Initialization Mode, of a step, and of a step as bytes."""
    d = e.fmu.description
    if not d.can_get_and_set_state:
        raise NotApplicable("it does not declare that its state can be copied")
    n = max(1, e.repeated // 2)
    with e.instance() as x:
        x.enter_initialization_mode(e.begin, None)
        initial = x.get_fmu_state()
        e.feed(x, 0)
        x.exit_initialization_mode()
        before = e.step(x, 0, n)
        state = x.get_fmu_state()
        data = x.serialize_fmu_state(state) if d.can_serialize_state else None
        after = e.step(x, n, n)
        x.set_fmu_state(state)
        yield from e.differences(after, e.step(x, n, n), "after the state was restored", n)
        if data is not None:
            x.set_fmu_state(x.deserialize_fmu_state(data))
            what = "after the serialized state was restored"
            yield from e.differences(after, e.step(x, n, n), what, n)
        x.set_fmu_state(initial)
        e.feed(x, 0)
        x.exit_initialization_mode()
        what = "after the state of Initialization Mode was restored"
        yield from e.differences(before, e.step(x, 0, n), what)
    kinds = "in Initialization Mode, between steps" + (", as bytes" if data is not None else "")
    e.summary = f"restored {kinds}: the same bits over {n} steps"


def reference(e: _Experiment) -> Iterator[str]:
    """Repeat the results that the archive carries."""
    carried = references(e.fmu)
    if not carried:
        raise NotApplicable("it carries no result (documentation/reference.csv, fmi-ls-ref)")
    summaries = []
    for one in carried:
        with e.instance() as x:
            texts, summary = deviations(e.fmu, x, one)
        if texts and e.fmu.interface == "ModelExchange" and one.tolerance == TOLERANCE:
            # The tolerance and the solver of the reference are unknown.
            raise NotApplicable(f"{texts[0]}, but a result follows from its solver, not named here")
        yield from texts
        summaries.append(summary)
    e.summary = "; ".join(summaries)


LOOKS: dict[str, Callable[[_Experiment], Iterator[str]]] = {
    look.__name__: look for look in (run, determinism, reset, state, reference)
}


def main() -> None:
    """Write the results of one FMU into a file, each as a line of JSON as soon as it is known."""
    path, target, *looks = sys.argv[1:]
    fmu, file = Path(path).resolve(), Path(target).resolve()
    with tempfile.TemporaryDirectory() as scratch, file.open("a", encoding="utf-8") as sink:

        def report(entry: Entry) -> None:
            sink.write(json.dumps(entry) + "\n")
            sink.flush()

        os.chdir(scratch)  # for FMUs that write into the working directory
        try:
            trial(fmu, looks, report)
        except FmuError as error:
            report({"check": "run", "result": "finding", "text": str(error)})
        os.chdir("/")


if __name__ == "__main__":
    main()
