import pytest

from uuvsim_cosim.models.declaration.element_names import (
    element_name,
    element_names,
    split_element_name,
)


@pytest.mark.parametrize(
    ("name", "shape", "names"),
    [
        ("x", (), ["x"]),
        ("x", (2,), ["x[1]", "x[2]"]),
        ("x", (1,), ["x[1]"]),
        ("M", (2, 2), ["M[1,1]", "M[1,2]", "M[2,1]", "M[2,2]"]),
        ("der(x)", (2,), ["der(x[1])", "der(x[2])"]),
        ("x", (0,), []),
    ],
)
def test_elements_are_named_as_fmi_2_names_them(
    name: str, shape: tuple[int, ...], names: list[str]
) -> None:
    assert element_names(name, shape) == names
    assert [element_name(name, shape, i) for i in range(len(names))] == names


@pytest.mark.parametrize(
    ("text", "read"),
    [
        ("hull.eta[6]", ("hull.eta", (6,))),
        ("M[1, 2]", ("M", (1, 2))),
        ("der(x[3])", ("der(x)", (3,))),
        ("eta", ("eta", ())),
        ("eta[1:3]", ("eta[1:3]", ())),
        ("[1]", ("[1]", ())),
    ],
)
def test_a_name_is_split_into_the_variable_and_its_indices(
    text: str, read: tuple[str, tuple[int, ...]]
) -> None:
    assert split_element_name(text) == read
