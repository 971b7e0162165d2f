"""Stepping a chain of first-order FMUs: this package beside other engines, in the same run.

µs of CPU time for one step of one FMU (all threads of the process), stepping alone and with every
signal recorded, and the ratio to a plain loop in C over the same FMI 2.0 FMUs. Medians; engines
take turns. Whether every y has the bits of the plain loop after 20 steps is printed beside.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from parts.lag_fmu import lag_fmu
from parts.lag_model import lag
from parts.peers_engines import ENGINES

from uuvsim_cosim.fmus.export.fmu_file import build_fmu

PACKAGES = {
    "uuvsim-cosim": "uuvsim-cosim",
    "FMPy, its API from a loop in Python": "fmpy",
    "FMPy, container FMU": "fmpy",
    "fmu-manipulation-toolbox, container FMU": "fmu-manipulation-toolbox",
    "libcosimpy": "libcosimpy",
    "ecospy": "ecospy",
}
Key = tuple[str, int, bool]


def once(engine: str, fmu: Path, n: int, steps: int, record: bool) -> tuple[float, list[str]] | str:
    """Run an engine once: CPU seconds and last values, or why there are none."""
    mode = "record" if record else "step"
    script = Path(__file__).parent / "parts" / "peers_engines.py"
    command = [sys.executable, str(script), engine, str(fmu), str(n), str(steps), mode]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    except subprocess.TimeoutExpired:
        return "did not end within 120 s"
    lines = done.stdout.strip().splitlines()
    if done.returncode == 0 or (lines and lines[-1].startswith('{"cpu"')):
        found = json.loads(lines[-1])
        return found["cpu"], found["y"]
    said = done.stderr.strip().splitlines()
    return said[-1] if said else f"ended with status {done.returncode}"


def processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return "unknown processor"
    return next((s.partition(": ")[2] for s in lines if s.startswith("model name")), "unknown")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=10_000)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--fmus", type=int, nargs="+", default=[2, 10, 50])
    parser.add_argument(
        "--exported",
        action="store_true",
        help="The lag that this package "
        "exports (RK4, some 80 ns a step) instead of the smallest one (5 ns).",
    )
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        fmu = build_fmu(lag(), fmi=2) if options.exported else lag_fmu(Path(folder))
        measure(fmu, options)


def measure(fmu: Path, options: argparse.Namespace) -> None:
    times: dict[Key, list[float]] = {}
    why: dict[Key, str] = {}
    bits = {(e, n): once(e, fmu, n, 20, False) for n in options.fmus for e in ENGINES}
    for _ in range(options.repeats):
        for n in options.fmus:
            for engine in ENGINES:
                for record in (False, True):
                    key = (engine, n, record)
                    if key in why:
                        continue
                    found = once(engine, fmu, n, options.steps, record)
                    if isinstance(found, str):
                        why[key] = found
                    else:
                        times.setdefault(key, []).append(found[0])
    print(f"{datetime.now(UTC):%Y-%m-%d}, {processor()}, {options.steps} steps, FMI 2.0")
    for n in options.fmus:
        print(f"\n{n} FMUs{'':34s}  us/FMU-step   ratio  recording   ratio  same bits")
        for engine in ENGINES:
            cells = []
            for record in (False, True):
                kept = times.get((engine, n, record))
                base = statistics.median(times["C loop", n, record])
                mine = statistics.median(kept) if kept else None
                each = None if mine is None else 1e6 * mine / (n * options.steps)
                cells.append("          -       -" if mine is None or each is None
                             else f"{each:11.3f} {mine / base:7.2f}")  # fmt: skip
            values, wanted = bits[engine, n], bits["C loop", n]
            same = "-" if isinstance(values, str) else "yes" if values[1] == wanted[1] else "no"
            name = engine if engine not in PACKAGES else f"{engine} ({_version(PACKAGES[engine])})"
            print(f"{name:42s} {cells[0]} {cells[1]}  {same}")
    told: dict[str, str] = {}
    for (engine, n, record), reason in why.items():
        told.setdefault(f"{engine}{', recording' if record else ''}: {reason}", str(n))
    for sentence in told:
        print(f"not measured: {sentence}")


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


if __name__ == "__main__":
    main()
