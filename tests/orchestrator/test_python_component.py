"""A user's class as a component: what it may declare, and how its mistakes are told."""

import os
import pickle
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.errors import ComponentFailed, FmuError, InputInvalid
from uuvsim_cosim.orchestrator.master import Master
from uuvsim_cosim.orchestrator.python_component import PythonComponent, load, load_python_component
from uuvsim_cosim.orchestrator.python_state import unpickled

GOOD = '''\
class Mine:
    """Doubles."""
    inputs = {"u": (2, "m")}
    outputs = {"y": (2, "m"), "n": "1"}
    parameters = {"gain": (2.0, "1"), "seed": ((0, 0), "1"), "name": ("x", "1")}

    def initialize(self, t):
        self.n = 10
        return {"n": self.n}

    def step(self, t, dt, u):
        self.n += 1
        return {"y": self.gain * u["u"], "n": self.n}
'''


def write(folder: Path, text: str) -> str:
    (folder / "my.py").write_text(text)
    return f"{folder / 'my.py'}:Mine"


def run(wired: Any, source: str, steps: int = 1) -> None:
    with Master(*wired({"a": lambda p: load_python_component(source, p)})) as master:
        master.initialize()
        master.step(steps)


def test_a_class_in_a_file_runs(wired: Any, tmp_path: Path) -> None:
    source = write(tmp_path, GOOD)
    start = {"a": {"u": np.array([1.0, 2.0]), "gain": 3.0}}
    w = wired({"a": lambda p: load_python_component(source, p)}, start=start)
    with Master(*w) as master:
        master.initialize()
        assert master.get("a", "n") == 10.0
        assert master.get("a", "y").tolist() == [0.0, 0.0]
        master.step(2)
        assert master.get("a", "n") == 12.0
        assert master.get("a", "y").tolist() == [3.0, 6.0]
        assert master.get("a", "seed").dtype == np.int32


def test_an_edited_file_is_read_again(tmp_path: Path) -> None:
    assert load(write(tmp_path, GOOD)).inputs == {"u": (2, "m")}
    assert load(write(tmp_path, GOOD.replace('(2, "m")}\n    out', '(3, "m")}\n    out'))).inputs == {"u": (3, "m")}  # fmt: skip  # noqa: E501


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("self.n += 1", "self.n += 1 / 0", r"my\.py:12: ZeroDivisionError: .*in step\(\)"),
        ("self.n = 10", "self.n = m", r"my\.py:8: NameError: .*in initialize\(\)"),
        (', "n": self.n}\n', "}\n", r"my\.py:11: step\(\) gives no n; expected a dict of y, n"),
        ('"n": self.n}\n', '"n": self.n, "z": 1}\n', r"gives z, which outputs does not name"),
        ('self.gain * u["u"]', "[1.0]", r"y: has shape \(1,\); expected \(2,\)"),
        ('"y": self.gain * u["u"]', '"y": "fast"', r"y: 'fast'; expected numbers"),
        ('return {"y"', 'return None and {"y"', r"returned NoneType; expected a dict of y, n"),
    ],
)
def test_a_mistake_in_a_step_is_told_with_file_and_line(
    old: str, new: str, text: str, wired: Any, tmp_path: Path
) -> None:
    assert old in GOOD
    with pytest.raises(ComponentFailed, match=text) as caught:
        run(wired, write(tmp_path, GOOD.replace(old, new)))
    assert "Traceback" not in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("class Mine", "class Other", "no class 'Mine'; expected one of Other"),
        ("class Mine:", "class Mine", r"my\.py:1: expected ':'"),
        ("class Mine", "import nothing_here\nclass Mine", r"my\.py:1: ModuleNotFoundError"),
        ("outputs =", "output =", r"Mine: no outputs; expected `inputs` and `outputs`"),
        ("def step", "def stop", r"Mine: no method step"),
        ('(2, "m")}', '"furlong"}', r"Mine.u: unknown unit 'furlong'"),
        ('(2, "m")}', '("m", 2)}', r"Mine.u: .*expected a unit such as"),
        ('(2.0, "1")', "2.0", r"Mine.gain: 2.0; expected \(value, unit\)"),
        ('{"y"', '{"u": "m", "y"', "u declared twice"),
    ],
)
def test_a_wrong_class_is_refused_before_it_runs(
    old: str, new: str, text: str, tmp_path: Path
) -> None:
    with pytest.raises(InputInvalid, match=text):
        PythonComponent(load(write(tmp_path, GOOD.replace(old, new, 1))), "a")


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputInvalid, match=re.escape(f"{tmp_path / 'no.py'}: no such file")):
        load(f"{tmp_path / 'no.py'}:Mine")
    with pytest.raises(InputInvalid, match=r"expected FILE.py:Class"):
        load("Mine")


def test_inputs_given_to_a_step_are_copies(wired: Any, tmp_path: Path) -> None:
    source = write(tmp_path, GOOD.replace("self.n += 1", 'u["u"] += 1; self.n += 1'))
    with Master(*wired({"a": lambda p: load_python_component(source, p)})) as master:
        master.initialize()
        master.step(3)
        assert master.get("a", "u").tolist() == [0.0, 0.0]
        assert master.get("a", "y").tolist() == [2.0, 2.0]


def test_bytes_that_would_run_code_are_refused() -> None:
    class Evil:
        def __reduce__(self) -> Any:
            return os.system, ("true",)

    with pytest.raises(FmuError, match=r"a: its state holds \w+\.system; expected numbers"):
        unpickled(pickle.dumps(Evil()), "a")
