"""A user's class as a component: what it may declare, and how its mistakes are told."""

import os
import pickle
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.errors import ComponentFailed, FmuError, InputInvalid
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.python.component import (
    PythonComponent,
    load,
    load_python_component,
    unpickled,
)
from uuvsim_cosim.orchestrator.system.system import System

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


def test_a_file_that_raises_is_not_half_imported(tmp_path: Path) -> None:
    (tmp_path / "half.py").write_text("class Mine: ...\nraise RuntimeError('not today')\n")
    for _ in range(2):  # the second time it is not found among the modules
        with pytest.raises(InputInvalid, match="not today"):
            load_python_component(f"{tmp_path / 'half.py'}:Mine", "a")
    assert not [name for name in sys.modules if name.startswith("uuvsim_user_half_")]


def with_gain(folder: Path, gain: float) -> str:
    folder.mkdir(exist_ok=True)
    (folder / "beside.py").write_text(f"GAIN = {gain}\n")
    return write(folder, "from beside import GAIN\n\n" + GOOD)


def test_files_of_two_folders_each_import_their_own_neighbours(tmp_path: Path) -> None:
    one, two = with_gain(tmp_path / "one", 1.5), with_gain(tmp_path / "two", 22.5)
    gains = [sys.modules[load(s).__module__].GAIN for s in (one, two, one)]
    assert gains == [1.5, 22.5, 1.5]


def test_a_neighbour_that_was_edited_is_read_again(tmp_path: Path) -> None:
    first = load(with_gain(tmp_path / "one", 1.5))
    assert load(f"{tmp_path / 'one' / 'my.py'}:Mine") is first
    again = load(with_gain(tmp_path / "one", 22.25))
    assert sys.modules[again.__module__].GAIN == 22.25


def test_an_edit_is_seen_within_a_second_and_through_another_neighbour(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    (tmp_path / "between.py").write_text("from beside import GAIN\n")
    law = write(tmp_path, "from between import GAIN\n\n" + GOOD)
    for gain in ("1.5", "2.5", "3.5"):  # the same size each time, and within a second
        (tmp_path / "beside.py").write_text(f"GAIN = {gain}\n")
        assert float(gain) == sys.modules[load(law).__module__].GAIN


def test_an_edit_of_the_same_size_within_a_second_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    for size in ("2", "3", "4"):
        law = write(tmp_path, GOOD.replace('{"u": (2, "m")}', f'{{"u": ({size}, "m")}}'))
        assert load(law).inputs == {"u": (int(size), "m")}


def test_an_edited_file_is_read_again(tmp_path: Path) -> None:
    assert load(write(tmp_path, GOOD)).inputs == {"u": (2, "m")}
    assert load(write(tmp_path, GOOD.replace('(2, "m")}\n    out', '(3, "m")}\n    out'))).inputs == {"u": (3, "m")}  # fmt: skip  # noqa: E501


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("self.n += 1", "self.n += 1 / 0", r"my\.py:12: ZeroDivisionError: .*in step\(\)"),
        ("self.n = 10", "self.n = m", r"my\.py:8: NameError: .*in initialize\(\)"),
        (
            ', "n": self.n}\n',
            "}\n",
            r"my\.py:11: step\(\) does not return n; expected a dict of y, n",
        ),
        ('"n": self.n}\n', '"n": self.n, "z": 1}\n', r"returns z, which outputs does not declare"),
        (
            'self.gain * u["u"]',
            "[1.0]",
            r"my\.py:11: step\(\) returns y: shape \(1,\); expected shape \(2,\)$",
        ),
        ('"y": self.gain * u["u"]', '"y": "fast"', r"returns y: 'fast'; expected numbers$"),
        ("self.n += 1", "import sys; sys.exit(5)", r"my\.py:12: SystemExit: 5: in step\(\)"),
        ("self.n = 10", "import sys; sys.exit(5)", r"my\.py:8: SystemExit: 5: in initialize\(\)"),
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
        ('inputs = {"u": (2, "m")}', "inputs = 3", r"Mine: inputs is 3; expected .*name -> unit"),
        ('"u": (2, "m")', '4: "m"', r"Mine: inputs has the name 4; expected"),
        ('parameters = {"gain"', 'parameters = [2]; x = {"gain"', r"Mine: parameters is \[2\]"),
        ('(2, "m")}', "0}", r"Mine.u: 0; expected a unit such as"),
        ('(2, "m")}', "True}", r"Mine.u: True; expected a unit such as"),
        ('(2.0, "1")', "(2.0, 1)", r"Mine.gain: unit 1; expected text such as"),
        (
            "def step(self, t, dt, u)",
            "def step(self, t)",
            r"my\.py:11: Mine\.step\(t\) cannot be called as step\(t, dt, u\): too many .*; "
            r"expected def step\(self, t, dt, u\)$",
        ),
        ("def step(self, t, dt, u)", "def step(t, dt, u)", r"my\.py:11: Mine\.step\(dt, u\)"),
        ("initialize(self, t)", "initialize(self)", r"my\.py:7: Mine\.initialize\(\) cannot be"),
        (
            "def initialize",
            "def __init__(self):\n        raise SystemExit\n\n    def initialize",
            r"^[^']*my\.py:8: SystemExit: in __init__\(\); expected a class that can be made",
        ),
        (
            "def initialize",
            "def __init__(self, gain):\n        pass\n\n    def initialize",
            r"my\.py:7: TypeError: .*'gain': in __init__\(\)",
        ),
        ("class Mine", "raise SystemExit(5)\nclass Mine", r"my\.py:1: SystemExit: 5"),
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


@pytest.mark.parametrize("method", ["step(self, t, dt, u)", "initialize(self, t)"])
def test_an_interrupt_in_a_class_stays_an_interrupt(
    method: str, wired: Any, tmp_path: Path
) -> None:
    broken = f"def {method}:\n        raise KeyboardInterrupt"
    with pytest.raises(KeyboardInterrupt):
        run(wired, write(tmp_path, GOOD.replace(f"def {method}:", broken)))


@pytest.mark.parametrize(
    "parameters", ["self, *given", "self, t, dt, u, extra=None", "self, time, h, inputs"]
)
def test_a_step_that_can_be_called_with_three_arguments_is_taken(
    parameters: str, tmp_path: Path
) -> None:
    text = GOOD.replace("step(self, t, dt, u)", f"step({parameters})")
    assert PythonComponent(load(write(tmp_path, text)), "a").description.name == "Mine"


@pytest.mark.parametrize(
    ("declared", "shape", "units"),
    [
        ("6", (6,), (None,) * 6),
        ("None", (), (None,)),
        ("(2, None)", (2,), (None, None)),
        ('(2, ("m", None))', (2,), ("m", None)),
    ],
)
def test_a_port_may_leave_its_unit_open(
    declared: str, shape: tuple[int, ...], units: tuple[str | None, ...], tmp_path: Path
) -> None:
    text = GOOD.replace('"u": (2, "m")', f'"u": {declared}')
    u = PythonComponent(load(write(tmp_path, text)), "a").description.variables["u"]
    assert (u.shape, u.units) == (shape, units)


def test_an_open_unit_is_filled_by_the_slot_and_listed(tmp_path: Path) -> None:
    system = System("loop", "0.01").add("hull", "model:bluerov2_heavy")
    system = system.add("controller", "model:controller").connect("controller.tau_d", "hull.tau")
    text = GOOD.replace('{"y": (2, "m"), "n": "1"}', '{"tau_d": 6}')
    found = system.replace("controller", write(tmp_path, text))
    assert found.describe("controller").variables["tau_d"].units == ("N",) * 3 + ("N.m",) * 3
    assert any(
        "controller: no unit given; those of the slot are used: tau_d" in n for n in found.notes
    )
