"""The sample: statements drawn evenly over all files, and one mutant of each, by a seed."""

from __future__ import annotations

import random
from collections.abc import Sequence
from pathlib import Path

from operators import Mutant, python_mutants
from operators_c import c_mutants

SEED, PYTHON, C = 20261123, 240, 60
RESERVE = 30  # for C that does not compile
PYTHON_FOLDERS = ("uuvsim_cosim",)
C_FOLDERS = ("fmus/runtime", "fmus/kernels", "fmus/whole", "fmus/guard", "orchestrator/core")


def draw(root: Path, seed: int = SEED, python: int = PYTHON, c: int = C) -> list[Mutant]:
    """Return mutants of Python and of C in a random order, then the reserve of C.

    Each statement that can be changed has the same probability; then each operator has.
    """
    draws = random.Random(seed)
    mutants = _drawn(root, files(root, PYTHON_FOLDERS, "*.py"), python_mutants, python, draws)
    more = _drawn(root, files(root, C_FOLDERS, "*.[ch]"), c_mutants, c + RESERVE if c else 0, draws)
    mixed = mutants + more[:c]
    draws.shuffle(mixed)
    return mixed + more[c:]


def files(root: Path, folders: Sequence[str], pattern: str) -> list[Path]:
    """Return the files of folders and of their subfolders that match a pattern."""
    return [p for folder in folders for p in sorted((root / folder).rglob(pattern))]


def _drawn(root, files, mutants_of, count, draws):  # type: ignore[no-untyped-def]
    statements = []
    for file in files:
        statements += mutants_of(file.relative_to(root).as_posix(), file.read_bytes())
    chosen = []
    for mutants in draws.sample(statements, min(count, len(statements))):
        operator = draws.choice(sorted({m.operator for m in mutants}))
        chosen.append(draws.choice([m for m in mutants if m.operator == operator]))
    return chosen
