"""Drawn masses that the actuators do not carry are refused, at the ends of their distributions."""

from __future__ import annotations

import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.envs import Randomisation, Uniform, Vary
from uuvsim_cosim.envs.randomisation.distributions import Choice, Normal
from uuvsim_cosim.envs.tasks import StationKeeping
from uuvsim_cosim.errors import SystemInvalid

HOLD = uuv.load("bluerov2_hold")  # the thrusters carry 143.7 N: 14.6 kg more or less than 13.4 kg
METRICS = {"depth": "final(hull.eta[3])"}


def drawn(*parameters: Vary, system: uuv.System = HOLD, **more: object) -> Randomisation:
    return Randomisation(parameters, system=system, **more)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("vary", "said"),
    [
        (Vary("hull.m", Uniform(13.0, 30.0)),
         "hull with m = 30, which is drawn: it sinks, because its weight of 294.6 N is 163 N more"),
        (Vary("hull.m", Uniform(0.8, 2.3), relative=True), "hull with m = 31.05, which is drawn"),
        (Vary("hull.m", Normal(13.5, 6.0, min=1.0, max=29.0)), "hull with m = 29"),
        (Vary("hull.nabla", Uniform(0.0134, 0.030)), "hull with nabla = 0.03, which is drawn: it "
         "rises"),
        (Vary("hull.m", Choice([13.5, 40.0])), "hull with m = 40"),
    ],
)  # fmt: skip
def test_the_ends_of_a_range_are_checked(vary: Vary, said: str) -> None:
    with pytest.raises(SystemInvalid) as refused:
        drawn(vary)
    assert said in str(refused.value)
    assert "or --force (in Python: with_mismatches('warn'))" in str(refused.value)


def test_a_range_within_what_is_carried_is_drawn() -> None:
    drawn(Vary("hull.m", Uniform(0.1, 27.9)))


def test_the_heaviest_hull_is_that_of_the_largest_mass_and_the_smallest_volume() -> None:
    m, nabla = Vary("hull.m", Uniform(13.5, 23.5)), Vary("hull.nabla", Uniform(0.008, 0.0134))
    drawn(m)
    drawn(nabla)
    with pytest.raises(SystemInvalid, match=r"hull with m = 23\.5, nabla = 0\.008, which is drawn"):
        drawn(m, nabla)
    with pytest.raises(SystemInvalid, match=r"it sinks"):
        drawn(m, nabla, correlation={("hull.m", "hull.nabla"): 0.3})


def test_correlated_ends_are_drawn_together() -> None:
    m, nabla = Vary("hull.m", Uniform(5.0, 30.0)), Vary("hull.nabla", Uniform(0.005, 0.030))
    drawn(m, nabla, correlation={("hull.m", "hull.nabla"): 0.95})
    with pytest.raises(SystemInvalid, match=r"hull with m = 30, nabla = 0\.005"):
        drawn(m, nabla, correlation={("hull.m", "hull.nabla"): -0.95})


def test_a_system_that_allows_it_is_warned() -> None:
    r = drawn(Vary("hull.m", Uniform(13.0, 30.0)), system=HOLD.with_mismatches("warn"))
    (text,) = r.remarks
    assert text.startswith("hull with m = 30, which is drawn: it sinks")
    assert "--force" not in text


def test_a_task_refuses_masses_that_sink_its_vehicle() -> None:
    with pytest.raises(SystemInvalid, match="hull with m = 40, which is drawn: it sinks"):
        StationKeeping(randomisation=Randomisation([Vary("hull.m", Uniform(13.0, 40.0))]))


def test_a_study_checks_the_masses_of_its_grid_and_of_its_draws() -> None:
    grid = [Vary("hull.m", Choice([13.5, 20.0, 32.0]))]
    with pytest.raises(SystemInvalid, match="hull with m = 32, which is drawn: it sinks"):
        uuv.Study(HOLD, duration=1, metrics=METRICS, grid=grid)
    both = [Vary("hull.nabla", Uniform(0.008, 0.0134))]
    with pytest.raises(SystemInvalid, match=r"hull with m = 23, nabla = 0\.00\d+, which is drawn"):
        uuv.Study(HOLD, duration=1, metrics=METRICS, seeds=20, parameters=both,
                  grid=[Vary("hull.m", Choice([13.5, 23.0]))])  # fmt: skip


def test_a_forced_study_reports_the_masses_that_sink(tmp_path: object) -> None:
    study = uuv.Study(
        HOLD.with_mismatches("warn"), duration="0.1", metrics=METRICS,
        grid=[Vary("hull.m", Choice([13.5, 32.0]))],
    )  # fmt: skip
    done = study.run(f"{tmp_path}/out", progress=False, jobs=1)
    assert [r for r in done.remarks if r.startswith("hull with m = 32, which is drawn: it sinks")]
