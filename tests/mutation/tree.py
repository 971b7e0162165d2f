"""A copy of the checkout: one mutant at a time is applied in it, and tests run in it."""

from __future__ import annotations

import contextlib
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

from closest import durations_of
from operators import Mutant
from processor_time import _children, _processor_time_of

LIMIT, IDLE = 60.0, 45.0  # [s] for one test: of processor time, and without any
WALL = 6.0  # real seconds for each second of processor time: a test that waits for ever ends
MEMORY = 12 * 2**30  # [byte] of addresses: a loop that allocates for ever ends

# Imported once, before the processes of the tests are forked from this one.
LIBRARIES = (
    "numpy scipy.integrate scipy.optimize scipy.spatial casadi control gymnasium pettingzoo torch "
    "pytest typer rich.console fmpy jsonschema lxml.etree ruamel.yaml"
)


@dataclass(frozen=True)
class Outcome:
    """The first test that failed, and how; neither if all passed; `late` if they were stopped."""

    failed: str = ""
    how: str = ""
    text: str = ""
    late: bool = False
    used: float = 0.0  # [s] of processor time
    failures: tuple[str, ...] = ()  # all of them


class Tree:
    """A copy of the checkout at `root`, with a cache of compiled code that all copies share."""

    def __init__(self, root: Path, folder: Path, number: int) -> None:
        self.folder, self.cache = folder / f"tree{number}", folder / "cache"
        self._scratch, self._times = folder / f"s{number}", 0
        self._compiled = folder / "pycache"
        self._durations = durations_of(folder)
        self.cache.mkdir(parents=True, exist_ok=True)
        shutil.rmtree(self.folder, ignore_errors=True)
        listed = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
        names = subprocess.run(listed, cwd=root, capture_output=True, check=True).stdout
        for name in filter(None, names.decode().split("\0")):
            if (root / name).is_file():
                (self.folder / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(root / name, self.folder / name)

    @contextlib.contextmanager
    def changed(self, mutant: Mutant) -> Iterator[None]:
        """Apply a mutant."""
        path = self.folder / mutant.path
        source, before = path.read_bytes(), path.stat()
        path.write_bytes(mutant.applied(source))
        self._times += 1
        os.utime(path, (10**9 + self._times,) * 2)  # no compiled module of another mutant fits
        try:
            yield
        finally:
            path.write_bytes(source)
            os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))

    def run(
        self,
        tests: Sequence[str],
        seconds: float,
        *,
        own_cache: bool = False,
        options: Sequence[str] = ("-x",),
    ) -> Outcome:
        """Run tests up to the first that fails, or until they have used so much processor time.

        Tests that were fast before come first. With `own_cache`, the cache that they fill is
        thrown away: code that fills it is changed.
        """
        shutil.rmtree(self._scratch, ignore_errors=True)
        (self._scratch / "t").mkdir(parents=True)
        cache = self.cache
        if own_cache:
            cache = self._scratch / "cache"
            shutil.copytree(
                self.cache,
                cache,
                copy_function=_linked,
                ignore=shutil.ignore_patterns("unpacking-*"),  # by another worker
            )
        process = os.fork()
        if process == 0:
            self._test(tests, cache, options)
        return self._watched(process, seconds)

    def _watched(self, process: int, seconds: float) -> Outcome:
        late, used, status, begun_at = False, 0.0, 0, time.monotonic()
        while True:
            done, status = os.waitpid(process, os.WNOHANG)
            if done:
                break
            used = max(used, _processor_time_of(process))
            if used > seconds or time.monotonic() - begun_at > WALL * seconds + IDLE:
                late = True
                _kill(process)
                os.waitpid(process, 0)
                break
            time.sleep(0.2)
        with contextlib.suppress(OSError):
            os.killpg(process, signal.SIGKILL)  # servers that the tests left
        begun, failures = "", []
        with contextlib.suppress(FileNotFoundError):
            for line in (self._scratch / "events").read_text().splitlines():
                event = json.loads(line)
                begun = event.get("begun", begun)
                failures += [event["failed"]] if "failed" in event else []
        if failures:
            first, names = failures[0], tuple(f["test"] for f in failures)
            return Outcome(first["test"], "fails", first["text"], False, used, names)
        if late:
            return Outcome(late=True, used=used)
        code = os.waitstatus_to_exitcode(status)
        if code in (0, 5):  # 5: no test was selected
            return Outcome(used=used)
        text = (self._scratch / "output").read_text(errors="replace")[-2000:]
        if code == 4 and not begun and "ImportError while loading conftest" not in text:
            raise ValueError(f"pytest did not run: {text}")
        how = f"ends by signal {-code}" if code < 0 else {70: "does not end"}.get(code, "fails")
        return Outcome(begun or "import", how, text, False, used)

    def _test(self, tests: Sequence[str], cache: Path, more: Sequence[str]) -> NoReturn:
        status = 1
        try:
            os.setsid()
            output = os.open(self._scratch / "output", os.O_WRONLY | os.O_CREAT)
            for number in (1, 2):
                os.dup2(output, number)
            os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
            resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            os.chdir(self.folder)
            sys.path[:] = [str(self.folder), *(p for p in sys.path if "mutation" not in p)]
            os.environ.update(
                PYTHONPATH=str(self.folder),
                UUVSIM_CACHE=str(cache),
                TMPDIR=str(self._scratch / "t"),
            )
            tempfile.tempdir = None
            # Compiled modules are kept, also if the user keeps none.
            os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
            os.environ["PYTHONPYCACHEPREFIX"] = sys.pycache_prefix = str(self._compiled)
            sys.dont_write_bytecode = False
            import pytest

            watch: Any = import_module("tests.processor_time").Watch
            watch.__init__.__defaults__ = (LIMIT, IDLE, 5.0)
            options = [*more, "-q", "-m", "not slow", "-p", "no:cacheprovider", "--tb=short"]
            options += ["--hypothesis-seed=0", f"--basetemp={self._scratch / 'b'}"]
            events = _Events(self._scratch / "events", self._durations)
            status = int(pytest.main([*options, *tests], plugins=[events]))
        except BaseException:  # the process ends here, whatever happened
            traceback.print_exc()
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(status)


class _Events:
    """Notes which test runs and which one failed, so that it is known after a crash."""

    def __init__(self, path: Path, durations: Path) -> None:
        self._file = path.open("a", encoding="utf-8")
        self._durations = durations

    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        known: dict[str, float] = {}
        if self._durations.is_file():
            known = dict(map(json.loads, self._durations.read_text().splitlines()))
        items.sort(key=lambda item: sum(known.get(item.nodeid, 0.5) > s for s in (1.0, 4.0, 15.0)))

    def _write(self, **event: Any) -> None:
        self._file.write(json.dumps(event) + "\n")
        self._file.flush()

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        self._write(begun=nodeid)

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.when == "call":
            with self._durations.open("a") as file:
                file.write(json.dumps([report.nodeid, report.duration]) + "\n")
        if report.failed:
            self._write(failed={"test": report.nodeid, "text": report.longreprtext[-4000:]})

    def pytest_collectreport(self, report: Any) -> None:
        if report.failed:
            self._write(failed={"test": report.nodeid, "text": report.longreprtext[-4000:]})


def _linked(source: str, target: str) -> None:
    with contextlib.suppress(FileNotFoundError):  # replaced meanwhile
        os.link(source, target)


def _kill(process: int) -> None:
    for child in _children(process):
        _kill(child)
    with contextlib.suppress(OSError):
        os.kill(process, signal.SIGKILL)


def load_libraries() -> None:
    """Import what most tests import; processes that are forked from this one have it."""
    for name in LIBRARIES.split():
        import_module(name)
