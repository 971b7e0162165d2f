"""Each public name has an example that runs; parameters and errors are named as they are.

An example is a paragraph ``Example:`` in a docstring, followed by lines of `doctest`. It imports
what it uses, so that a reader can paste it. A class shows its methods and properties in its own
docstring or in theirs.

Constants (`api.CONSTANTS`) need no example: an example of the function that uses them shows them.
"""

from __future__ import annotations

import builtins
import doctest
import inspect
import re
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from uuvsim_cosim import errors, studies
from uuvsim_cosim.bridge.zenoh import session
from uuvsim_cosim.learn.shared import errors as learn_errors
from uuvsim_cosim.learn.training import interruption

sys.path.insert(0, str(Path(__file__).parents[2] / "docs" / "extensions"))

import api

OPTIONS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
PARSER = doctest.DocTestParser()
RAISES = re.compile(r"\braises? ([^.]*)", re.I)
CAMEL = re.compile(r"\b(?:[A-Z][a-z]+){2,}\b")

EXCEPTIONS = (studies.StudyInterrupted,)  # without a constructor of their own

# Modules that define errors.
DEFINING = (builtins, errors, interruption, learn_errors, session, studies)

NAMES = {path: value for path, value in api.public_names().items() if path not in api.CONSTANTS}
CHECKED = pytest.mark.parametrize("path", sorted(NAMES))


def members(path: str) -> dict[str, Any]:
    """Return the public methods and properties of a public name, without former names."""
    every = api.public_members(NAMES[path])
    return {k: member for k, member in every.items() if getattr(member, "__name__", k) == k}


@cache
def docstrings(path: str) -> dict[str, str]:
    """Return the docstrings of a public name ("") and of its methods and properties."""
    every = {"": NAMES[path], **members(path)}
    return {name: inspect.getdoc(value) or "" for name, value in every.items()}


def code(docstring: str) -> str:
    """Return the code of the examples of a docstring."""
    return "".join(example.source for example in PARSER.get_examples(docstring))


def prose(docstring: str) -> str:
    """Return a docstring without its examples."""
    return "".join(x for x in PARSER.parse(docstring) if isinstance(x, str))


def parameters(path: str) -> Iterator[tuple[str, str]]:
    """Yield the parameters of a public name and of its methods, each after its owner ("")."""
    value: Any
    for owner, value in {"": NAMES[path], **members(path)}.items():
        value = getattr(value, "__func__", value)  # of a classmethod
        bare = getattr(value, "_is_protocol", False) or value in EXCEPTIONS
        if callable(value) and not bare:
            for name in inspect.signature(value).parameters:
                if name not in ("self", "cls") and not name.startswith("_"):
                    yield owner, name


def test_each_public_name_is_a_constant_a_function_or_a_class() -> None:
    for path, value in api.public_names().items():
        assert (path in api.CONSTANTS) != (inspect.isclass(value) or inspect.isroutine(value)), path


@CHECKED
def test_a_public_name_has_an_example_and_shows_its_members(path: str) -> None:
    texts = docstrings(path)
    own = code(texts[""])
    assert own, f"{path} has no example"
    for member, text in texts.items():
        if member:
            assert re.search(rf"\.{member}\b", own + code(text)), f"no example of {path}.{member}"


@CHECKED
def test_the_examples_of_a_public_name_run(
    path: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    report: list[str] = []
    for member, text in docstrings(path).items():
        name = f"{path}.{member}".rstrip(".")
        runner = doctest.DocTestRunner(optionflags=OPTIONS)
        runner.run(PARSER.get_doctest(text, {}, name, name, 0), out=report.append)
    assert not report, "".join(report)


@CHECKED
def test_each_parameter_is_named_in_a_docstring(path: str) -> None:
    texts = {member: prose(text) for member, text in docstrings(path).items()}
    missing = [
        f"{owner}({name})"
        for owner, name in parameters(path)
        if not re.search(rf"\b{name}\b", texts[owner] + texts[""])
    ]
    assert not missing, f"{path}: {missing}"


@CHECKED
def test_each_error_that_a_docstring_promises_exists(path: str) -> None:
    for member, text in docstrings(path).items():
        for sentence in RAISES.findall(prose(text)):
            for name in CAMEL.findall(sentence):
                assert any(name in dir(x) for x in DEFINING), f"{path}.{member}: {name}"
