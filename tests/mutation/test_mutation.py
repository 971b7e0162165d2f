"""The operators of the mutation testing change the code, and a seed gives the same sample."""

from __future__ import annotations

import ast
import sys
from argparse import Namespace
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

import run
from operators import Mutant, python_mutants
from operators_c import c_mutants
from sample import C_FOLDERS, PYTHON_FOLDERS, draw, files
from tree import Outcome

PYTHON = b'''"""Text."""
__all__ = ["f"]
def f(x: int, y: float = 2.0) -> int:
    """Text."""
    log.info("%d", 3)
    for k in range(x):
        if not k < 3 and y:
            continue
        try:
            x += k * 2
        except ValueError:
            raise KeyError(f"{x + 1}") from None
    return x if x is None else -x
'''
C = b"""/* 1 + 2 */
#define N 3
static int f(double *x, int n) {
    for (int i = 0; i < n; i++) {
        if (x[i] > 1.5 && n != N) {
            break;
        }
        x[i] += n * 2;
        note("a + b");
    }
    free(x);
    return n - 1;
}
"""


def changes(mutants: list[list[Mutant]]) -> set[tuple[str, str]]:
    return {(m.old, m.new) for found in mutants for m in found}


def test_each_operator_changes_what_it_names() -> None:
    found = changes(python_mutants("f.py", PYTHON))
    assert {
        ("2.0", "3.0"), ("2.0", "1.0"), ("range(x)", "()"), ("not k < 3", "(k < 3)"), ("<", "<="),
        ("<", ">="), ("and", "or"), ("continue", "break"), ("+=", "-="), ("*", "/"),
        ("x += k * 2", "pass"), ("ValueError", "()"), ("-x", "(x)"), ("is", "is not"),
        ("x is None", "not (x is None)"), ("return x if x is None else -x", "return None"),
    } <= found  # fmt: skip
    found = changes(c_mutants("f.c", C))
    assert {
        ("<", "<="), (">", ">="), ("&&", "||"), ("!=", "=="), ("break", "continue"), ("+=", "-="),
        ("*", "/"), ("2", "3"), ("1.5", "2.5"), ("free(x)", "(void)0"), ("-", "+"),
    } <= found  # fmt: skip


def test_text_is_not_changed() -> None:
    found = changes(python_mutants("f.py", PYTHON)) | changes(c_mutants("f.c", C))
    assert not any(word in old for old, _ in found for word in ("Text", "log", "1 + 2"))
    assert ("3", "4") not in changes(c_mutants("f.c", C))  # the preprocessor's
    raised = [m for s in python_mutants("f.py", PYTHON) for m in s if m.line == 12]
    assert [m.new for m in raised] == ["pass"]


@pytest.mark.parametrize(
    "path", ["uuvsim_cosim/models/actuators/thruster.py", "uuvsim_cosim/errors.py"]
)
def test_every_mutant_is_other_code_that_can_be_read(path: str) -> None:
    source = (Path(__file__).parents[2] / path).read_bytes()
    same = ast.dump(ast.parse(source))
    for mutants in python_mutants(path, source):
        for mutant in mutants:
            assert ast.dump(ast.parse(mutant.applied(source))) != same, mutant


def test_a_mutant_of_older_code_is_refused() -> None:
    [[mutant, *_], *_] = python_mutants("f.py", PYTHON)
    with pytest.raises(ValueError, match="draw a new sample"):
        mutant.applied(b"#" + PYTHON)


def test_subfolders_are_drawn_from_too() -> None:
    root = Path(__file__).parents[2]
    drawn = files(root, C_FOLDERS, "*.[ch]") + files(root, PYTHON_FOLDERS, "*.py")
    for name in ("fmus/runtime/math/uuv_math.h", "orchestrator/core/iteration/newton.c",
                 "fmus/whole/uuv_client.h", "uuvsim_cosim/models/hull/vehicle.py"):  # fmt: skip
        assert root / name in drawn


def test_where_tests_fail_without_a_mutant_none_is_judged(monkeypatch: pytest.MonkeyPatch) -> None:
    class Broken:
        def __init__(self, *_: object) -> None: ...

        def run(self, *_: object) -> Outcome:
            return Outcome("import", "fails", "no such folder")

    monkeypatch.setattr(run, "Tree", Broken)
    with pytest.raises(SystemExit, match="without a mutant, import fails:\nno such folder"):
        run.work(0, Namespace(folder=Path()))


def test_a_seed_gives_the_same_sample(tmp_path: Path) -> None:
    for name, source in (("uuvsim_cosim/f.py", PYTHON), ("orchestrator/core/f.c", C)):
        (tmp_path / name).parent.mkdir(parents=True)
        (tmp_path / name).write_bytes(source)
    first = draw(tmp_path, seed=1, python=4, c=2)
    assert first == draw(tmp_path, seed=1, python=4, c=2)
    assert first != draw(tmp_path, seed=2, python=4, c=2)
    assert {m.path for m in first} == {"uuvsim_cosim/f.py", "orchestrator/core/f.c"}
