import pytest

from uuvsim_cosim.models.declaration.near_names import did_you_mean, expected_names

NAMES = ["hull.eta", "hull.nu", "current.v_c"]


@pytest.mark.parametrize(
    ("name", "known", "what", "text"),
    [
        ("hull.etta", NAMES, "", "one such as hull.eta, hull.nu"),
        ("zzz", NAMES, "", "one of hull.eta, hull.nu, current.v_c"),
        ("zzz", NAMES, "a signal", "a signal, one of hull.eta, hull.nu, current.v_c"),
        ("hull.etta", NAMES[:1], "a signal", "a signal such as hull.eta"),
        ("hull.eta", [], "", "a name, but there is none"),
        (3, [1, 30], "", "one such as 30"),
        ("", range(21), "", f"one of {', '.join(map(str, range(20)))}, …"),
    ],
)
def test_a_wrong_name_is_answered_with_near_ones_or_those_that_exist(
    name: object, known: list[object], what: str, text: str
) -> None:
    assert expected_names(name, known, what) == text


def test_near_names_are_offered_as_a_question() -> None:
    assert did_you_mean("hul.nu", NAMES) == " (did you mean hull.nu?)"
    assert did_you_mean("zzz", NAMES) == ""


def test_a_name_of_a_million_characters_is_compared_by_its_beginning() -> None:
    assert expected_names("hull.eta" + "x" * 10**6, NAMES).startswith("one of")
