"""Mutation testing: change one place of the code, and see whether the tests that run it fail.

    pip install pytest-cov
    nice python tests/mutation/run.py --folder runs/mutants --lines      # which test runs what
    nice python tests/mutation/run.py --folder runs/mutants              # the whole sample
    nice python tests/mutation/run.py --folder runs/mutants --round more --seconds 200
    nice python tests/mutation/run.py --folder runs/mutants --confirm
    python tests/mutation/page.py                                        # docs/results/mutants.md

The tests that failed are run once more without a mutant (`--confirm`), where they must pass: a
mutant that was caught by one that does not pass counts as a survivor, until another round.
The checkout is not changed: each worker has a copy of it under `--folder`, beside the cache of
compiled code. Results are appended to a file, and a run that was stopped goes on there. A round
other than `first` runs the survivors again that have tests left, or tests of their own (`--tests`).
"""

from __future__ import annotations

import argparse
import json
import os
import re
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

from closest import Lines, c_tests
from operators import Mutant
from sample import PYTHON, RESERVE, SEED, C, draw
from tree import Outcome, Tree, load_libraries

ROOT = Path(__file__).parents[2]
RESULTS = Path(__file__).parent / "results.jsonl"
NEAREST = 8  # tests that run before the others
DOES_NOT_COMPILE = re.compile(r"C compiler .* failed with status")
FILLS_THE_CACHE = re.compile(r"\b(cache_dir|keep|intact|write_whole)\(")

Record = dict[str, Any]


def records(path: Path = RESULTS) -> list[Record]:
    """Return all results, in the order in which they were made."""
    return [json.loads(line) for line in path.read_text().splitlines()] if path.is_file() else []


def mutant_of(record: Record) -> Mutant:
    """Return the mutant of a result."""
    return Mutant(**record["mutant"])


class Judge:
    """Runs tests against mutants in one tree."""

    def __init__(self, tree: Tree, options: argparse.Namespace) -> None:
        self.tree, self.most, self.seconds = tree, options.most, options.seconds
        self._clean = options.results.with_name("clean.jsonl")
        self._lines = Lines(options.folder)

    def judged(self, mutant: Mutant, tests: list[str]) -> Record:
        """Return the status of a mutant, and the test that caught it."""
        root, used = self.tree.folder, 0.0
        c = mutant.path.endswith((".c", ".h"))
        own_cache = bool(FILLS_THE_CACHE.search((root / mutant.path).read_text()))
        closest = tests or (c_tests(mutant) if c else self._lines.tests(root, mutant))
        chosen = closest[: self.most]
        nearest = 2 if c else NEAREST
        outcome, status, passed = Outcome(), "survived", 0
        for stage in (chosen[:nearest], chosen[nearest:]):
            if not stage or status != "survived" or used >= self.seconds:
                break
            with self.tree.changed(mutant):
                try:
                    outcome = self._run(stage, self.seconds - used, own_cache)
                except ValueError:  # a mutant may change the names of a test's parameters
                    stage = [*dict.fromkeys(t.partition("[")[0] for t in stage)]
                    outcome = self._run(stage, self.seconds - used, own_cache)
            used += outcome.used
            if not outcome.failed:
                passed += 0 if outcome.late else len(stage)
            elif c and DOES_NOT_COMPILE.search(outcome.text):
                status = "does not compile"
            else:
                status = "caught"
        caught = {"test": outcome.failed, "how": outcome.how} if status == "caught" else {}
        return {"status": status, **caught, "seconds": round(used, 1), "passed": passed,
                "of": len(closest)}  # fmt: skip

    def _run(self, tests: Sequence[str], seconds: float, own_cache: bool) -> Outcome:
        left = [x for t in self.known(False) for x in ("--deselect", t)]
        return self.tree.run([*tests, *left], seconds, own_cache=own_cache)

    def known(self, passes: bool) -> list[str]:
        """Return the tests that are known to pass, or to fail, without a mutant."""
        lines = self._clean.read_text().splitlines() if self._clean.is_file() else []
        return sorted({t for t, p in map(json.loads, lines) if p == passes})

    def confirm(self, tests: Sequence[str]) -> None:
        """Run tests without a mutant, and note which of them pass."""
        chosen = sorted({*tests} - {*self.known(True), *self.known(False)})
        if not chosen:
            return
        # "import": a mutant with which no test can be collected.
        outcome = self.tree.run(
            ["tests/test_cache.py" if t == "import" else t for t in chosen], 3600.0, options=()
        )
        if outcome.late or (outcome.failed and not outcome.failures):
            raise SystemExit(f"{outcome.failed} {outcome.how} without a mutant: {outcome.text}")
        with self._clean.open("a") as file:
            for test in chosen:
                file.write(json.dumps([test, test not in outcome.failures]) + "\n")
        print(f"{len(chosen)} tests, of which fail: {list(outcome.failures)}", flush=True)


def due(options: argparse.Namespace) -> list[tuple[int, Mutant]]:
    """Return number and mutant of each mutant that this round has still to judge."""
    known = records(options.results)
    latest = {r["number"]: r for r in known}
    if options.round == "first":
        sample = draw(ROOT, options.seed, options.python, options.c)
        for number, record in latest.items():
            if number < len(sample) and mutant_of(record) != sample[number]:
                raise SystemExit(
                    f"{options.results}: mutant {number} is of another sample or of older code; "
                    "move the file away to begin anew"
                )
        return [(n, m) for n, m in enumerate(sample) if n not in latest]
    done = {r["number"] for r in known if r["round"] == options.round and not options.again}
    return [
        (n, mutant_of(r))
        for n, r in sorted(latest.items())
        if r["status"] == "survived"
        and n not in done
        and (options.tests or r["passed"] < r.get("of", 10**9))
    ]


def work(part: int, options: argparse.Namespace) -> None:
    """Judge each mutant of one worker's part."""
    tree = Tree(ROOT, options.folder, part)
    begun = tree.run(["tests/test_cache.py"], 300.0)
    if begun.failed or begun.late:  # else each mutant would count as caught
        raise SystemExit(f"without a mutant, {begun.failed} {begun.how}:\n{begun.text}")
    judge = Judge(tree, options)
    chosen = json.loads(options.tests.read_text()) if options.tests else {}
    for number, mutant in due(options)[part :: options.jobs]:
        tests: list[str] = chosen.get(str(number), [])
        if chosen and not tests:
            continue
        if mutant.path.endswith((".c", ".h")) and enough(options):
            continue
        begin = time.monotonic()
        try:
            result = judge.judged(mutant, tests)
        except ValueError as error:
            print(error, flush=True)
            continue
        record = {"number": number, "round": options.round, "mutant": asdict(mutant), **result}
        with options.results.open("a") as file:
            file.write(json.dumps(record) + "\n")
        print(f"{number:4} {result['status']:8} {time.monotonic() - begin:4.0f} s  {mutant.path}:"
              f"{mutant.line} {mutant.operator}  {result.get('test', '')}", flush=True)  # fmt: skip


def record_lines(options: argparse.Namespace) -> None:
    """Run the tests once, and record which of them execute which lines."""
    tree = Tree(ROOT, options.folder, options.jobs)
    (tree.folder / ".coveragerc").write_text(
        "[run]\nrelative_files = true\nbranch = false\n"
        f"data_file = {options.folder / 'lines.coverage'}\n"
    )
    outcome = tree.run(
        ["tests"], 1e5,
        options=[f"-n{options.jobs}", "--cov=uuvsim_cosim", "--cov-context=test", "--cov-report=",
                 "--cov-config=.coveragerc",
                 *(f"--ignore=tests/{n}" for n in ("docs", "benchmarks", "mutation"))],
    )  # fmt: skip
    print(f"{outcome.used:.0f} s; failed: {list(outcome.failures)}; {outcome.text[-500:]}")


def confirm(options: argparse.Namespace) -> None:
    """Run the tests that failed without a mutant; mutants whose test does not pass survived."""
    judge = Judge(Tree(ROOT, options.folder, options.jobs), options)
    latest = {r["number"]: r for r in records(options.results)}
    caught = [r for r in latest.values() if r["status"] == "caught"]
    judge.confirm([r["test"] for r in caught])
    unsound = {*judge.known(False)} - {*judge.known(True)}
    with options.results.open("a") as file:
        for record in caught:
            if record["test"] in unsound:
                file.write(json.dumps({**record, "status": "survived", "how": "unsound"}) + "\n")


def enough(options: argparse.Namespace) -> bool:
    """Return whether the C mutants that compile are as many as were asked for."""
    if options.round != "first":
        return False
    judged = [r for r in records(options.results) if r["mutant"]["path"].endswith((".c", ".h"))]
    return sum(r["status"] != "does not compile" for r in judged) >= options.c


def main(arguments: Sequence[str] | None = None) -> None:
    """Judge the mutants of a sample."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument(
        "--folder", type=lambda f: Path(f).resolve(), required=True, help="for copies and the cache"
    )
    parser.add_argument("--round", default="first", help="another name: run the survivors again")
    parser.add_argument("--again", action="store_true", help="also those that the round has judged")
    parser.add_argument("--tests", type=Path, help="JSON: tests by number, instead of the closest")
    parser.add_argument("--confirm", action="store_true", help="run the tests that failed")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--lines", action="store_true", help="record which test runs which line")
    parser.add_argument("--most", type=int, default=60, help="tests (files of them for C)")
    parser.add_argument("--seconds", type=float, default=60.0, help="processor time for a mutant")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--python", type=int, default=PYTHON, help="mutants of Python")
    parser.add_argument("--c", type=int, default=C, help=f"mutants of C, and {RESERVE} in reserve")
    parser.add_argument("--results", type=Path, default=RESULTS)
    options = parser.parse_args(arguments)
    os.environ["OMP_NUM_THREADS"] = "1"  # the workers share the processor
    load_libraries()
    if options.lines:
        record_lines(options)
        return
    if options.confirm:
        confirm(options)
        return
    workers = []
    for part in range(options.jobs):
        worker = os.fork()
        if worker == 0:
            work(part, options)
            os._exit(0)
        workers.append(worker)
    ended = [os.waitpid(worker, 0)[1] for worker in workers]
    if any(ended):
        raise SystemExit(1)


if __name__ == "__main__":
    main()
