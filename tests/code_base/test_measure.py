"""`.ci/measure.py` counts what its docstring defines, on a package of four small files."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

SCRIPT = Path(__file__).parents[2] / ".ci" / "measure.py"
FILES = {
    "__init__.py": '"""Package."""\n',
    "a.py": '''"""One."""
from typing import TYPE_CHECKING, Any
from small import b  # an edge
if TYPE_CHECKING:
    from small.c import C
def used(x: Any, y: "Any") -> int:
    """Give one."""
    import torch
    return _once() + _twice() + _twice()
def _once() -> int:
    """Return one."""
    return 1
def _twice() -> int:  # noqa: D103
    return 2
''',
    "b.py": '''"""Two."""
def late():
    """Gives a."""
    from small.a import used
    return used
''',
    "c.py": '''"""Three."""
from small import a
class C:
    """Give no name."""
''',
}


@pytest.fixture(scope="module")
def measure() -> ModuleType:
    spec = importlib.util.spec_from_file_location("measure", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["measure"] = module  # dataclasses look there
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def measured(measure: ModuleType, tmp_path: Path) -> dict[str, Any]:
    folder = tmp_path / "small"
    folder.mkdir()
    for name, text in FILES.items():
        (folder / name).write_text(text)
    found: dict[str, Any] = measure.measure(folder)
    return found


def test_measures_are_those_of_the_definitions(measured: dict[str, Any]) -> None:
    assert measured["files"] == 4
    assert measured["lines"] == sum(len(t.splitlines()) for t in FILES.values())
    assert measured["functions"] == 4
    assert measured["single-use helpers"] == 1
    assert measured["import cycles"] == [["small.a", "small.b"]]
    every = measured["import cycles, imports for types included"]
    assert every == [["small.a", "small.b", "small.c"]]
    inside = measured["imports inside functions"]
    assert (inside["total"], inside["own"], inside["extras"]) == (2, 1, 1)
    assert inside["by extra"] == {"rl: torch": 1}
    assert measured["Any per thousand lines"] == round(2000 / measured["lines"], 1)
    assert measured["comments per thousand lines"] == round(1000 / measured["lines"], 1)
    assert measured["docstrings"] == 8
    assert measured['docstrings that begin with "Give"'] == 3


def test_the_table_names_each_measure(measure: ModuleType, measured: dict[str, Any]) -> None:
    text = "\n".join(measure.table(measured))
    assert "rl: torch" in text
    assert "2 modules: a, b" in text
