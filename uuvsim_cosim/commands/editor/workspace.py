"""A folder for VS Code: settings, tasks, debugging, snippets, schemas and a development container.

The files name no path of this machine except for the interpreter, which an editor lets the user
choose again.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from uuvsim_cosim._version import __version__
from uuvsim_cosim.commands.editor.snippets import snippets
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.modeline import PATTERNS, schemas
from uuvsim_cosim.orchestrator.shipped.scaffold import class_name, files_for
from uuvsim_cosim.orchestrator.system.slot import Slot

__all__ = ["workspace_files", "write_workspace"]

EXTENSIONS = ["ms-python.python", "ms-python.debugpy", "redhat.vscode-yaml"]
TEST = '''\
"""Test of {file}: {system} runs with it, and every output is finite."""

import tempfile
import unittest

import numpy as np

import uuvsim_cosim as uuv


class Test{name}(unittest.TestCase):
    def test_the_system_runs_with_it(self):
        system = uuv.load("{system}").replace("{path}", "{file}:{name}")
        with tempfile.TemporaryDirectory() as folder:
            signals = uuv.run(system, until=5, out=folder).signals()
            for name in {signals}:
                self.assertTrue(np.all(np.isfinite(signals[f"{path}.{{name}}"])), name)


if __name__ == "__main__":
    unittest.main()
'''


def write_workspace(folder: Path, system: str, slot: Slot) -> list[Path]:
    """Write the files; raises InputInvalid, and writes nothing, if one of them exists already."""
    files = workspace_files(folder, system, slot)
    shown = {name: ".vscode/schemas" if "/schemas/" in name else name for name in files}
    existing = dict.fromkeys(shown[name] for name in files if (folder / name).exists())
    if existing:
        raise InputInvalid(
            folder, f"{', '.join(existing)} exist already", "a folder without these files"
        )
    try:
        for name, text in files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputInvalid(f"{folder}: cannot be written ({error.strerror})") from None
    return [folder / name for name in files]


def workspace_files(folder: Path, system: str, slot: Slot) -> dict[str, str]:
    """Return the text of each file by its name: a component, its test, and those for the editor."""
    component = files_for(slot, "python")
    (file,) = component
    name = class_name(slot)
    swap = f"{slot.path}={file}:{name}"
    outputs = [c.name for c in slot.connectors if c.direction == "output"]
    test = TEST.format(file=file, system=system, name=name, path=slot.path, signals=outputs)
    return {
        **component,
        f"test_{file}": test,
        ".vscode/settings.json": _json(_settings(folder)),
        ".vscode/tasks.json": _json(_tasks(system, swap)),
        ".vscode/launch.json": _json(_launch(system, swap)),
        ".vscode/extensions.json": _json({"recommendations": EXTENSIONS}),
        ".vscode/uuvsim.code-snippets": _json(snippets()),
        ".devcontainer/devcontainer.json": _json(_container()),
        **{
            f".vscode/schemas/{path.name}": path.read_text(encoding="utf-8")
            for path in schemas().values()
        },
    }


def _json(value: object) -> str:
    return json.dumps(value, indent=2, ensure_ascii=False) + "\n"


def _settings(folder: Path) -> dict[str, Any]:
    interpreter, top = Path(sys.executable), folder.resolve()
    if interpreter.is_relative_to(top):
        shown = f"${{workspaceFolder}}/{interpreter.relative_to(top).as_posix()}"
    else:
        shown = str(interpreter)
    return {
        "python.defaultInterpreterPath": shown,
        "python.testing.unittestEnabled": True,
        "python.testing.unittestArgs": ["-v", "-s", ".", "-p", "test_*.py"],
        "yaml.schemas": {
            f"./.vscode/schemas/{schema}.schema.json": list(patterns)
            for schema, patterns in PATTERNS.items()
        },
        "files.exclude": {"**/__pycache__": True},
    }


def _tasks(system: str, swap: str) -> dict[str, Any]:
    def task(label: str, *arguments: str, **more: Any) -> dict[str, Any]:
        return {
            "label": f"uuvsim: {label}",
            "type": "process",
            "command": "${command:python.interpreterPath}",
            "args": ["-m", *arguments],
            "problemMatcher": [],
            **more,
        }

    matcher = {
        "owner": "uuvsim",
        "fileLocation": ["relative", "${workspaceFolder}"],
        "pattern": {"regexp": r"^(.+?):(\d+): (.*)$", "file": 1, "line": 2, "message": 3},
    }
    run = ("uuvsim_cosim", "run", system, "--replace", swap)
    return {
        "version": "2.0.0",
        "tasks": [
            task("run", *run, group={"kind": "build", "isDefault": True}),
            task("report", "uuvsim_cosim", "report", "${input:run}"),
            task("lint", "uuvsim_cosim", "lint", ".", problemMatcher=matcher),
            task("test", "unittest", "-v", group={"kind": "test", "isDefault": True}),
        ],
        "inputs": [
            {
                "id": "run",
                "type": "promptString",
                "description": "Folder of the run",
                "default": f"runs/{system}-0",
            }
        ],
    }


def _launch(system: str, swap: str) -> dict[str, Any]:
    shared = {
        "type": "debugpy",
        "request": "launch",
        "cwd": "${workspaceFolder}",
        "console": "integratedTerminal",
        "justMyCode": True,
    }
    run = ["run", system, "--replace", swap, "--until", "60", "--no-report"]
    return {
        "version": "0.2.0",
        "configurations": [
            {
                "name": "uuvsim: run, with breakpoints",
                **shared,
                "module": "uuvsim_cosim",
                "args": run,
            },
            {"name": "uuvsim: this Python file", **shared, "program": "${file}"},
        ],
    }


def _container() -> dict[str, Any]:
    return {
        "name": "uuvsim-cosim",
        "image": "python:3.11-slim",
        "postCreateCommand": f"python -m pip install --find-links . uuvsim-cosim=={__version__}",
        "customizations": {"vscode": {"extensions": EXTENSIONS}},
    }
