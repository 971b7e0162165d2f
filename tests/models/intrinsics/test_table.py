"""Tables: exact on their rows, linear between, flat beyond, differentiable, one instruction."""

import casadi as ca
import numpy as np
import pytest

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.intrinsics.table import TABLES, interpolants, table1, table2

X, Y = [0.0, 1.0, 3.0], [10.0, 20.0]
V1 = [0.1, 0.7, -0.3]
V2 = [[0.1, 0.7, -0.3], [1.0, 2.0, 5.0]]


def one(*at: float) -> float:
    x = ca.SX.sym("x", len(at))
    y = table1(X, V1)(x) if len(at) == 1 else table2(X, Y, V2)(x[0], x[1])
    return float(ca.Function("f", [x], [y])(at))


@pytest.mark.parametrize(("x", "value"), list(zip(X, V1, strict=True)))
def test_a_row_comes_back_exactly(x: float, value: float) -> None:
    assert one(x) == value


@pytest.mark.parametrize("i", range(3))
@pytest.mark.parametrize("j", range(2))
def test_a_point_of_two_grids_comes_back_exactly(i: int, j: int) -> None:
    assert one(X[i], Y[j]) == V2[j][i]


@pytest.mark.parametrize(("at", "value"), [((2.0,), 0.2), ((-9.0,), 0.1), ((9.0,), -0.3)])
def test_between_rows_it_is_linear_and_beyond_them_flat(at: tuple[float], value: float) -> None:
    assert one(*at) == pytest.approx(value, abs=1e-15)


def test_between_two_grids_it_is_bilinear() -> None:
    assert one(2.0, 12.5) == pytest.approx(0.75 * 0.2 + 0.25 * 3.5, abs=1e-14)
    assert one(2.0, 99.0) == pytest.approx(3.5, abs=1e-14)


def test_the_gradient_is_that_of_finite_differences() -> None:
    x = ca.SX.sym("x", 2)
    y = ca.sin(table2(X, Y, V2)(x[0], x[1]))
    f = ca.Function("f", [x], [y])
    gradient = np.array(ca.Function("g", [x], [ca.jacobian(y, x)])([1.7, 13.0])).ravel()
    at, step = np.array([1.7, 13.0]), 1e-6
    for i in range(2):
        d = np.eye(2)[i] * step
        slope = (float(f(at + d)) - float(f(at - d))) / (2 * step)
        assert gradient[i] == pytest.approx(slope, abs=1e-8)


def test_the_gradient_is_zero_beyond_the_grid() -> None:
    x, seed = ca.SX.sym("x"), ca.SX.sym("seed")
    f = ca.Function("f", [x, seed], [ca.jtimes(table1(X, V1)(x), x, seed)])
    assert float(f(-1.0, 1.0)) == float(f(4.0, 1.0)) == 0.0
    assert float(f(0.5, 2.0)) == pytest.approx(1.2, abs=1e-14)


def test_a_table_is_one_call_whatever_its_size() -> None:
    x = ca.SX.sym("x")
    grid = np.linspace(0, 1, 500)
    f = ca.Function("f", [x], [table1(list(grid), list(grid**2))(x)])
    assert f.n_instructions() == 3
    assert [f.instruction_id(k) for k in range(3)].count(ca.OP_CALL) == 1


def test_equal_contents_have_one_name_and_other_contents_another() -> None:
    x = ca.SX.sym("x")
    names = [ca.Function("f", [x], [table1(X, v)(x)]).find_functions()[0].name() for v in (V1, V1)]
    assert names[0] == names[1]
    assert TABLES[names[0]].values == tuple(V1)
    table1(X, [1.0, 2.0, 4.0])
    assert sum(t.x == tuple(X) and t.n_in == 1 for t in TABLES.values()) >= 2


def test_nan_is_passed_on() -> None:
    assert np.isnan(one(float("nan")))


@pytest.mark.parametrize("grid", [[0.0, 0.0, 1.0], [0.0, 2.0, 1.0], [0.0]])
def test_a_grid_that_does_not_rise_is_refused(grid: list[float]) -> None:
    with pytest.raises(ParameterInvalid, match="expected two or more, rising"):
        table1(grid, grid)


@pytest.mark.parametrize("at", [(-1.0, 12.0), (0.4, 9.0), (2.0, 13.0), (3.5, 25.0)])
def test_casadis_interpolant_is_the_same_function_with_the_same_gradient(
    at: tuple[float, float],
) -> None:
    def of(x: float, y: float) -> tuple[float, list[float]]:
        a = ca.SX.sym("a", 2)
        f = ca.Function("f", [a], [table2(X, Y, V2)(a[0], a[1])])
        b = ca.MX.sym("b", 2)
        J = ca.Function("J", [b], [ca.jacobian(f(b), b)])
        return float(f([x, y])), [float(v) for v in J([x, y]).full().ravel()]

    usual = of(*at)
    with interpolants():
        quick = of(*at)
    assert quick[0] == pytest.approx(usual[0], abs=1e-14)
    assert quick[1] == pytest.approx(usual[1], abs=1e-12)
