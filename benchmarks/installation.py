"""Size of an installation, what `uuvsim run` needs of it, and what shipped binaries would change.

The first table lists the distributions of this environment by size and marks those that
`uuvsim run SYSTEM` imports, beside those that it only runs (the compiler). The second compares the
processor time of the first run, which compiles, with that of a second run. The third builds the
components for each platform and adds up the binaries. Run it in an environment that has nothing but
the core: `pip install .`.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import resource
import subprocess
import sys
import tempfile
import zipfile
from importlib import metadata
from pathlib import Path

from uuvsim_cosim.models.declaration.library import available

# Runs the command, then prints the distributions of which a module was imported.
IMPORTED = """
import contextlib, json, sys
from importlib import metadata
from uuvsim_cosim.cli import main
with contextlib.suppress(SystemExit), contextlib.redirect_stdout(sys.stderr):
    main(sys.argv[1:])
names = metadata.packages_distributions()
tops = {m.partition(".")[0] for m in sys.modules}
print(json.dumps(sorted({d for t in tops for d in names.get(t, [])})))
"""


def sizes() -> dict[str, float]:
    """Return the size of each installed distribution [MB], its libraries included."""
    found = {}
    for distribution in metadata.distributions():
        files = [Path(str(distribution.locate_file(f))) for f in distribution.files or ()]
        size = sum(f.stat().st_size for f in files if f.is_file())
        found[str(distribution.metadata["Name"])] = size / 1e6
    return found


def timed_run(arguments: list[str], cache: Path) -> tuple[float, list[str]]:
    """Run `uuvsim` in a process; return its processor time [s] and the imported distributions."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, "-c", IMPORTED, *arguments],
        env={**os.environ, "UUVSIM_CACHE": str(cache)},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = sum(getattr(after, k) - getattr(before, k) for k in ("ru_utime", "ru_stime"))
    return seconds, json.loads(done.stdout.splitlines()[-1])


def binaries(
    names: list[str], platforms: list[str], folder: Path
) -> dict[str, tuple[float, float]]:
    """Return the size of all binaries [MB] of each platform, plain and compressed."""
    found = {}
    for platform in platforms:
        out = folder / platform
        words = ["fmu", "build", *names, "--fmi", "2", "--platform", platform, "-o", str(out)]
        subprocess.run([sys.executable, "-m", "uuvsim_cosim", "--quiet", *words], check=True)
        plain, packed = 0, io.BytesIO()
        with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
            for fmu in sorted(out.glob("*.fmu")):
                with zipfile.ZipFile(fmu) as parts:
                    for part in (n for n in parts.namelist() if n.startswith("binaries/")):
                        data = parts.read(part)
                        plain += len(data)
                        archive.writestr(f"{fmu.stem}/{part}", data)
        found[platform] = (plain / 1e6, len(packed.getvalue()) / 1e6)
    return found


def main() -> None:
    """Print the three tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--system", default="bluerov2_survey")
    parser.add_argument("--until", default="5")
    parser.add_argument("--components", help="comma-separated; all by default")
    parser.add_argument("--platforms", default="linux64,win64,darwin64,aarch64-darwin")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        run = ["run", asked.system, "--until", asked.until, "--out"]
        cold, imported = timed_run([*run, str(folder / "first")], folder / "cache")
        warm, _ = timed_run([*run, str(folder / "second")], folder / "cache")
        everything = sizes()
        total = sum(everything.values())
        needed = sum(everything[name] for name in imported if name in everything)
        print(f"{'distribution':26}{'size [MB]':>10}  used by uuvsim run {asked.system}")
        for name, size in sorted(everything.items(), key=lambda e: -e[1])[:16]:
            use = "imported" if name in imported else "run" if name == "ziglang" else ""
            print(f"{name:26}{size:10.1f}  {use}")
        print(f"{'all ' + str(len(everything)):26}{total:10.1f}")
        print(f"{'imported':26}{needed:10.1f}  {needed / total:.0%} of all\n")
        print(f"first run, which compiles: {cold:.1f} CPU s; second run: {warm:.1f} CPU s; "
              f"ratio {cold / warm:.1f}\n")  # fmt: skip
        shipped = [n for n in available() if "@" not in n]
        names = asked.components.split(",") if asked.components else shipped
        print(f"{'binaries of ' + str(len(names)) + ' components':26}{'MB':>8}{'compressed':>12}")
        sums = binaries(names, asked.platforms.split(","), folder)
        for platform, (plain, packed) in sums.items():
            print(f"{platform:26}{plain:8.1f}{packed:12.1f}")
        print(f"{'all':26}{sum(a for a, _ in sums.values()):8.1f}"
              f"{sum(b for _, b in sums.values()):12.1f}")  # fmt: skip


if __name__ == "__main__":
    main()
