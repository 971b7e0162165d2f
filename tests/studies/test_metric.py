from collections.abc import Mapping
from fractions import Fraction

import numpy as np
import pytest

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.description import Description
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.running.library import load
from uuvsim_cosim.studies.metric import Metric, read_metric

TIME = np.arange(11) / 10
ETA = np.column_stack([TIME, -2 * TIME, TIME**2, 0 * TIME, 0 * TIME, 3 + TIME])
NU = np.column_stack([np.cos(TIME), *[TIME] * 5])
COURSES = {"hull.eta": ETA, "hull.nu": NU}


@pytest.fixture(scope="module")
def there() -> Mapping[str, Description]:
    return {c.path: c.description for c in flatten(load("bluerov2_hold")).components}


CASES = {
    "rms(hull.eta[1])": np.sqrt(np.mean(TIME**2)),
    "mean(hull.eta[2])": -1.0,
    "std(hull.eta[1])": np.std(TIME),
    "min(hull.eta[2])": -2.0,
    "max(abs(hull.eta[2]))": 2.0,
    "first(hull.eta[6])": 3.0,
    "final(hull.eta[6])": 4.0,
    "quantile(hull.eta[1], 0.95)": 0.95,
    "integral(hull.eta[1])": 0.5,
    "share(hull.eta[1] > 0.75)": 3 / 11,
    "max(norm(hull.eta[1:2]))": np.sqrt(5),
    "max(abs(wrap(hull.eta[6])))": 3.1,
    "rms(hull.eta[1] - hull.nu[2])": 0.0,
    "max(hull.eta[1]) - min(hull.eta[1]) * 2 + 1": 2.0,
    "max(-hull.eta[1] / 4 + (1 - 2) * 3)": -3.0,
    "mean(sqrt(hull.eta[1] * hull.eta[1]))": 0.5,
}


@pytest.mark.parametrize("expression", CASES)
def test_a_metric_is_its_formula(expression: str, there: Mapping[str, Description]) -> None:
    found = read_metric("m", Metric(expression), there).value(TIME, COURSES)
    np.testing.assert_allclose(found, [CASES[expression]], atol=1e-12)


def test_a_metric_of_a_vector_has_a_column_for_each_element(
    there: Mapping[str, Description],
) -> None:
    m = read_metric("end", Metric("final(hull.eta)"), there)
    assert m.columns == tuple(f"end[{i}]" for i in range(1, 7))
    assert m.value(TIME, COURSES) == list(ETA[-1])


def test_a_window_leaves_out_what_came_before_and_after(there: Mapping[str, Description]) -> None:
    window = Metric("mean(hull.eta[1])", after=Fraction("0.4"), until=Fraction("0.6"))
    assert read_metric("m", window, there).value(TIME, COURSES) == [pytest.approx(0.5)]


def test_a_division_by_zero_gives_no_finite_number_and_no_warning(
    there: Mapping[str, Description],
) -> None:
    m = read_metric("m", Metric("mean(hull.eta[1] / hull.eta[4])"), there)
    assert not np.isfinite(m.value(TIME, COURSES)).any()


@pytest.mark.parametrize(
    ("expression", "unit"),
    [("rms(hull.eta[1])", "m"), ("max(hull.eta[1] - guidance.cross_track)", "m"),
     ("share(hull.eta[1] < 1)", "1"), ("max(2 * hull.eta[6])", "rad"),
     ("max(hull.eta[1] * hull.eta[1])", None), ("final(hull.eta)", None)],
)  # fmt: skip
def test_a_metrics_unit_is_known_where_it_has_a_name(
    expression: str, unit: str | None, there: Mapping[str, Description]
) -> None:
    assert read_metric("m", Metric(expression), there).root.unit == unit


@pytest.mark.parametrize(
    ("expression", "says"),
    [
        ("rms(hull.etta)", "character 5: no variable 'etta'.*such as eta"),
        ("rms(hul.eta)", "such as hull"),
        ("hull.eta[1]", r"rms\(hull.eta\[1\]\)"),
        ("max(abs(hull.eta[3])", "character 21: the end; expected '\\)'"),
        ("rsm(hull.eta)", "function 'rsm'; expected one such as rms"),
        ("quantile(hull.eta[1], 3)", r"a number in \[0, 1\]"),
        ("quantile(hull.eta[1])", "expected ','"),
        ("rms(hull.eta - hull.nu[1:3])", "6 - 3 elements"),
        ("rms(hull.eta[7])", "indices from 1 to 6"),
        ("rms(3)", "rms of a number; expected a signal"),
        ("rms(hull.eta) $", r"'\$'"),
        ("rms(hull.eta) 3", "an operator"),
        ("", "the end"),
        ("__import__('os')", "expected"),
    ],
)
def test_what_is_no_metric_is_refused_with_its_place(
    expression: str, says: str, there: Mapping[str, Description]
) -> None:
    with pytest.raises(InputInvalid, match=says):
        read_metric("m", Metric(expression), there)
