"""Errors carry what they report as data, and their sentence is made of it."""

from __future__ import annotations

import pickle

import pytest

from uuvsim_cosim.errors import InputInvalid, Problem, SystemInvalid

WHOLE = Problem("hull.m", "-1 kg", "more than 0")


@pytest.mark.parametrize(
    ("parts", "problem", "sentence"),
    [
        (("no such file",), Problem("", "no such file", ""), "no such file"),
        (("a", "b"), Problem("", "a", "b"), "a; expected b"),
        (("hull.m", "-1 kg", "more than 0"), WHOLE, "hull.m: -1 kg; expected more than 0"),
    ],
)  # fmt: skip
def test_an_error_is_its_problem_and_its_sentence(
    parts: tuple[str, ...], problem: Problem, sentence: str
) -> None:
    error = InputInvalid(*parts)  # type: ignore[call-overload]
    for e in (error, pickle.loads(pickle.dumps(error))):
        assert e.problems == (problem,)
        assert str(e) == sentence


@pytest.mark.parametrize("count", [0, 4])
def test_no_part_of_an_error_is_dropped(count: int) -> None:
    with pytest.raises(TypeError, match=rf"{count} parts of an error"):
        InputInvalid(*["x"] * count)  # type: ignore[call-overload]


def test_several_problems_stand_below_each_other_and_stay_data() -> None:
    error = InputInvalid.of([WHOLE, "a whole sentence"])
    assert str(error) == "hull.m: -1 kg; expected more than 0\n  a whole sentence"
    assert pickle.loads(pickle.dumps(error)).problems == error.problems
    assert str(SystemInvalid(error.problems)).startswith("2 problems:\n  hull.m: -1 kg")


def test_an_error_at_another_place_keeps_all_that_it_says() -> None:
    assert InputInvalid("a", "b", "c").at("here", "x") == Problem("here", "a: b", "c")
    assert InputInvalid("b").at("here", "x") == Problem("here", "b", "x")
    more = InputInvalid.of([WHOLE, WHOLE]).at("here", "x")
    assert str(more) == f"here: {WHOLE}\n  {WHOLE}"
