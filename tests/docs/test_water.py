"""The tables of the page on real vehicles are those that the command computes."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from uuvsim_cosim.studies.water.judge import judge
from uuvsim_cosim.studies.water.page import block_of, page_with, table_of
from uuvsim_cosim.studies.water.recordings import recording, recordings

PAGE = Path(__file__).parents[2] / "docs" / "water.md"
TEXT = PAGE.read_text(encoding="utf-8")
NUMBER = re.compile(r"(?<![\w.])\d+(?:\.\d+)?(?:e[+-]?\d+)?")


@pytest.mark.parametrize(
    "name",
    [
        "slocum_2016",
        pytest.param("bluerov2_arm", marks=pytest.mark.slow),
        pytest.param("seaexplorer_2020", marks=pytest.mark.slow),
    ],
)
def test_the_table_of_a_shipped_recording_is_computed_again(name: str) -> None:
    printed = block_of(TEXT, name)
    found = table_of(judge(recording(name)))
    assert NUMBER.sub("n", found) == NUMBER.sub("n", printed)  # the verdicts among them
    pairs = zip(NUMBER.findall(found), NUMBER.findall(printed), strict=True)
    assert [(a, b) for a, b in pairs if float(a) != pytest.approx(float(b), rel=0.02)] == []


def test_each_recording_has_a_table_and_a_picture() -> None:
    for each in recordings():
        assert "| windows |" in block_of(TEXT, each.name), each.name
        assert (PAGE.parent / "images" / f"water_{each.name}.svg").is_file()


def test_the_summary_counts_the_verdicts_of_the_tables() -> None:
    assert page_with(TEXT, [], recordings()) == TEXT
