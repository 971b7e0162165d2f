"""A fitted set as a distribution: draws have the errors of the fit, and tasks use the set."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from uuvsim_cosim.envs.randomisation.distributions import Uniform
from uuvsim_cosim.envs.randomisation.published import published
from uuvsim_cosim.envs.randomisation.randomisation import Randomisation
from uuvsim_cosim.envs.task.episode_draws import Draws
from uuvsim_cosim.envs.tasks.station_keeping import StationKeeping
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.parameter_files import vehicle_folder
from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.studies.identification.identify import Identified, Number
from uuvsim_cosim.studies.identification.save import save_as

CORRELATION = np.array([[1.0, -0.8, 0.1, 0.0], [-0.8, 1.0, 0.3, 0.0],
                        [0.1, 0.3, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])  # fmt: skip
# Value, deviation and unit of each number; the data do not determine the last one.
NUMBERS = {
    "D_q_11": (21.0, 1.5, "N.s2/m2"), "M_A_11": (7.0, 0.5, "kg"), "D_q_33": (30.0, 2.0, "N.s2/m2"),
    "D_q_66": (1.5, 9.0, "N.m.s2/rad2"),
}  # fmt: skip


def fit_of(source: str) -> Identified:
    numbers = tuple(
        Number(f"hull.{n}", v, v - 1.96 * s, v + 1.96 * s, v, unit, (f"hull.{n}",), False)
        for n, (v, s, unit) in NUMBERS.items()
    )
    return Identified(
        numbers, CORRELATION, {"u": 0.01}, (), (), "hull", source, {}, (), "dive.csv", 100, 10.0,
        0.1, 3, True, "", (),
    )  # fmt: skip


@pytest.fixture
def saved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], str]:
    def save(source: str) -> str:
        (file,) = save_as(fit_of(source), "my_rov@my_fit")
        return file.source.removeprefix("model:")

    monkeypatch.chdir(tmp_path)
    return save


def table(drawn: Randomisation, names: list[str], count: int = 4000) -> np.ndarray:
    start = drawn.draw(Draws(seeds=list(range(count)), episodes=[0] * count))
    return np.stack([start[f"hull.{n}"] for n in names])


@pytest.mark.parametrize("place", ["", "{shipped}@"])
def test_a_vehicle_of_the_package_is_not_changed(place: str) -> None:
    shipped = vehicle_folder("bluerov2_heavy")
    before = {f: f.read_bytes() for f in shipped.iterdir() if f.is_file()}
    with pytest.raises(InputInvalid, match="--save-as my_bluerov2_heavy@my_fit"):
        save_as(fit_of("model:bluerov2_heavy"), f"{place.format(shipped=shipped)}my_fit")
    assert before == {f: f.read_bytes() for f in shipped.iterdir() if f.is_file()}


@pytest.mark.parametrize("name", ["true", "null", "Fit", "1"])
def test_a_name_that_a_file_would_read_as_no_text_is_refused_before_anything_is_copied(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputInvalid, match="expected lower case letters"):
        save_as(fit_of("model:bluerov2_heavy@wu_2018"), f"my_rov@{name}")
    assert not list(tmp_path.iterdir())


def test_a_set_states_that_its_fit_did_not_converge(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    found = fit_of("model:bluerov2_heavy@wu_2018")
    save_as(replace(found, converged=False, status="interrupted"), "my_rov@my_fit")
    text = (tmp_path / "my_rov" / "parameters.yaml").read_text(encoding="utf-8")
    assert "not converged after 3 iterations: interrupted" in text


def test_draws_of_an_identified_set_have_the_covariance_of_its_errors(
    saved: Callable[[str], str],
) -> None:
    vehicle = saved("model:bluerov2_heavy@wu_2018")
    system = System("s", "0.1").add("hull", f"model:{vehicle}")
    drawn = published(vehicle).bound(system)
    names = list(NUMBERS)[:3]
    assert isinstance(drawn.parameters[0].distribution, Uniform)  # not fitted: as published
    rows = table(drawn, names)
    # Within about four standard deviations of the estimates from 4000 draws.
    assert np.corrcoef(rows) == pytest.approx(CORRELATION[:3, :3], abs=0.06)
    for name, row in zip(names, rows, strict=True):
        value, std, _ = NUMBERS[name]
        assert row.mean() == pytest.approx(value, abs=4 * std / np.sqrt(4000))
        assert row.std() == pytest.approx(std, rel=0.06)


def test_correlations_of_another_set_and_of_publications_are_not_drawn_with(
    saved: Callable[[str], str],
) -> None:
    saved("model:bluerov2_heavy@wu_2018")
    system = System("s", "0.1").add("hull", "model:my_rov@wu_2018")
    drawn = published("my_rov@wu_2018").bound(system)
    assert ("hull.D_q_11", "hull.M_A_11") not in drawn.correlation
    assert ("hull.W", "hull.B") in drawn.correlation  # a trimmed vehicle, as published
    fitted = published("my_rov@my_fit")
    assert fitted.correlation["hull.D_q_11", "hull.M_A_11"] == pytest.approx(-0.8)


def test_a_task_flies_the_fitted_set_and_draws_its_errors_in_each_episode(
    saved: Callable[[str], str],
) -> None:
    vehicle = saved("model:bluerov2_heavy")
    task = StationKeeping(vehicle=vehicle, randomise=True)
    assert task.randomisation is not None
    rows = table(task.randomisation, ["D_q_11", "M_A_11"], 400)
    assert rows[0].mean() == pytest.approx(21.0, abs=0.4)
    assert np.corrcoef(rows)[0, 1] == pytest.approx(-0.8, abs=0.1)
    fixed = StationKeeping(vehicle=vehicle)
    assert fixed.system.components["hull"].source.endswith(vehicle)
