"""Every MATLAB file parses, those too that only MATLAB can run; nobody here has MATLAB."""

from __future__ import annotations

from pathlib import Path

import pytest
import tree_sitter
import tree_sitter_matlab

MATLAB = Path(__file__).parents[3] / "matlab"
FILES = sorted(MATLAB.rglob("*.m"))


def parsed(text: bytes) -> tree_sitter.Node:
    language = tree_sitter.Language(tree_sitter_matlab.language())
    return tree_sitter.Parser(language).parse(text).root_node


@pytest.mark.parametrize("file", FILES, ids=[f.name for f in FILES])
def test_a_file_is_matlab(file: Path) -> None:
    root = parsed(file.read_bytes())
    wrong = [n.start_point.row + 1 for n in _nodes(root) if n.is_error or n.is_missing]
    assert wrong == [], f"{file.name}: lines {wrong}"


def test_the_parser_sees_what_is_wrong() -> None:
    assert parsed(b"function f(\n  x = [1, 2;\nend\n").has_error


@pytest.mark.parametrize("file", FILES, ids=[f.name for f in FILES])
def test_a_files_lines_are_no_longer_than_a_hundred(file: Path) -> None:
    long = [n for n, line in enumerate(file.read_text("utf-8").splitlines(), 1) if len(line) > 100]
    assert long == []


def test_the_block_has_the_methods_that_simulink_asks_a_system_object_for() -> None:
    root = parsed((MATLAB / "+uuvsim" / "CosimBlock.m").read_bytes())
    names = {
        n.child_by_field_name("name").text.decode()  # type: ignore[union-attr]
        for n in _nodes(root)
        if n.type == "function_definition"
    }
    assert names >= {
        "setupImpl", "resetImpl", "outputImpl", "updateImpl", "releaseImpl",
        "isInputDirectFeedthroughImpl", "getOutputSizeImpl", "getOutputDataTypeImpl",
        "isOutputComplexImpl", "isOutputFixedSizeImpl", "getSampleTimeImpl", "getSimulateUsingImpl",
    }  # fmt: skip


def _nodes(node: tree_sitter.Node) -> list[tree_sitter.Node]:
    return [node, *(n for child in node.children for n in _nodes(child))]
