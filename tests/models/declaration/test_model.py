"""Declarations: what cannot be declared is refused where it is written."""

import casadi as ca
import numpy as np
import pytest

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.declaration.model import Model


def test_a_name_is_declared_once() -> None:
    m = Model("m")
    m.input("u", unit="1")
    with pytest.raises(ParameterInvalid, match="'u' is declared twice"):
        m.state("u", unit="1")


@pytest.mark.parametrize("h_max", [0.0, -0.01, float("nan"), float("inf")])
def test_the_longest_step_is_more_than_zero(h_max: float) -> None:
    with pytest.raises(ParameterInvalid, match=r"lag: h_max .* s; expected more than 0"):
        Model("lag", h_max=h_max)


def test_a_matrix_is_read_row_by_row() -> None:
    m = Model("m")
    a = m.parameter("A", np.array([[1.0, 2.0], [3.0, 4.0]]), unit="1")
    values = ca.Function("f", [m.variables["A"].symbol], [a])(m.variables["A"].start)
    np.testing.assert_array_equal(np.array(values), [[1.0, 2.0], [3.0, 4.0]])


def test_zeros_of_a_derived_value_stay_structural() -> None:
    m = Model("m")
    p = m.parameter("p", 2.0, unit="1")
    d = m.derived("D", ca.diag(ca.vertcat(p, 2 * p)))
    assert d.nnz() == 2


def test_an_equation_of_the_wrong_size_is_refused() -> None:
    m = Model("m")
    x = m.state("x", np.zeros(3), unit="m")
    with pytest.raises(ParameterInvalid, match=r"m\.x: equation has 2 elements; expected 3"):
        m.der(x, ca.SX.zeros(2))


def test_only_a_declared_state_has_a_derivative() -> None:
    m = Model("m")
    u = m.input("u", unit="1")
    with pytest.raises(ParameterInvalid, match="not a declared state"):
        m.der(u, 0)


def test_noise_brings_a_seed() -> None:
    m = Model("m")
    m.normal(m.clock("c", "0.1"))
    assert m.variables["seed"].type == "Int32"
    assert m.variables["seed"].shape == (2,)


def test_a_period_is_exact() -> None:
    assert Model("m").clock("c", 0.1).period == Model("m").clock("c", "1/10").period


def test_an_unknown_unit_names_model_and_variable() -> None:
    with pytest.raises(ParameterInvalid, match=r"m\.u"):
        Model("m").input("u", unit="parsec")
