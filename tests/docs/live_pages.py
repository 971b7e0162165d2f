"""Small Sphinx projects with the live parts of the documentation, and their files in node."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

DOCS = Path(__file__).parents[2] / "docs"
NEEDS_NODE = pytest.mark.skipif(shutil.which("node") is None, reason="no node on this machine")
CONF = f"""
import sys
sys.path.insert(0, {str(DOCS / "extensions")!r})
extensions = ["myst_nb", "live"]
nb_execution_mode = "off"
html_theme = "furo"
default_role = "literal"
exclude_patterns = ["html"]
"""


def built(folder: Path, pages: Mapping[str, str]) -> Path:
    """Build files of pages with warnings as errors; return the folder of the HTML."""
    folder.mkdir(exist_ok=True)
    (folder / "conf.py").write_text(CONF, encoding="utf-8")
    texts = {"index.md": "# Index\n\n```{toctree}\n:glob:\n\n*\n```\n", **pages}
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    command = [sys.executable, "-m", "sphinx", "-W", "-q", "-b", "html", str(folder)]
    done = subprocess.run(
        [*command, str(folder / "html")], check=False, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return folder / "html"


def in_node(folder: Path, files: Mapping[str, str], tasks: Sequence[Mapping[str, Any]]) -> Any:
    """Compute live responses in node from the files of their pages; return what was found."""
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    (folder / "task.json").write_text(json.dumps(tasks), encoding="utf-8")
    script = Path(__file__).with_name("live_node.js").read_text(encoding="utf-8")
    done = subprocess.run(
        ["node", "-e", script, str(folder)], check=False, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return json.loads((folder / "result.json").read_text(encoding="utf-8"))
