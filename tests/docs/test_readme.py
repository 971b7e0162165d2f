"""The README's first screen: its Python runs, its picture is there, its commands are CI's."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def block(mark: str, language: str) -> str:
    found = re.search(rf"<!-- {mark} -->\n```{language}\n(.*?)```", README, re.DOTALL)
    assert found is not None, mark
    return found[1]


def test_the_python_of_the_readme_runs_as_it_stands(tmp_path: Path) -> None:
    code = "import matplotlib; matplotlib.use('Agg')\n" + block("python", "python")
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "track.png").stat().st_size > 1000


def test_the_python_of_the_readme_is_about_ten_lines() -> None:
    assert len([line for line in block("python", "python").splitlines() if line.strip()]) <= 10


def test_ci_runs_the_readmes_test_command() -> None:
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    taken = re.search(r"test_command=\$\((.*)\)\n", script)
    assert taken is not None
    done = subprocess.run(
        ["bash", "-c", taken[1]], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == block("test command", "bash").strip()
    assert 'bash -euo pipefail -c "$test_command"' in script


def test_the_picture_and_the_links_of_the_readme_exist() -> None:
    for target in re.findall(r"\]\(([^)#]+)\)", README):
        if "://" not in target:
            assert (ROOT / target).exists(), target
