"""Files of the repository that pages and docstrings name are there."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

ROOT = Path(__file__).parents[2]
NAMED = re.compile(r"[\w./-]*\w/[\w.-]+\.(?:py|c|h)\b")
TOP = re.compile(r"(?:uuvsim_cosim|tests|orchestrator|fmus|models|docs|benchmarks)/")
# Results state what was measured then, and of which file; tests of mutants invent names.
LEFT_OUT = ("docs/results/", "tests/mutation/", "tests/freeze/")


def test_files_that_are_named_exist() -> None:
    listed = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    files = subprocess.run(listed, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    known = {
        "/".join(parts[i:])
        for parts in (f.split("/") for f in files.splitlines())
        for i in range(len(parts))
    }
    assert "uuvsim_cosim/cli.py" in known
    missing = [
        f"{file}: {name}"
        for file in files.splitlines()
        if file.endswith((".md", ".py", ".c", ".h")) and not file.startswith(LEFT_OUT)
        for name in {n.lstrip("./") for n in NAMED.findall((ROOT / file).read_text("utf-8"))}
        if TOP.match(name) and name not in known
    ]
    assert not missing
