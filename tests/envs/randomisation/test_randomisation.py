from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.content import content
from uuvsim_cosim.envs.randomisation.distributions import (
    Choice,
    Constant,
    Distribution,
    LogUniform,
    Normal,
    Uniform,
)
from uuvsim_cosim.envs.randomisation.privileged import with_privileged
from uuvsim_cosim.envs.randomisation.published import (
    current,
    delays,
    published,
    sensor_noise,
    thruster_strength,
)
from uuvsim_cosim.envs.randomisation.randomisation import Randomisation, Vary
from uuvsim_cosim.envs.task.episode_draws import Draws
from uuvsim_cosim.envs.task.task import Channel, Moment, Task
from uuvsim_cosim.envs.tasks import TargetTracking
from uuvsim_cosim.envs.team import CosimParallelEnv
from uuvsim_cosim.errors import InputInvalid, SystemInvalid
from uuvsim_cosim.models.declaration.parameter_files import parameter_set, read_yaml, vehicle_sets
from uuvsim_cosim.orchestrator.running.library import load
from uuvsim_cosim.orchestrator.shipped.tracking import target_tracking
from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.studies import Study

N = 400
DRAWS = Draws(np.arange(N), np.zeros(N, int))


@pytest.fixture(scope="module")
def hold() -> System:
    return load("bluerov2_hold")


@pytest.fixture(scope="module")
def survey() -> System:
    return load("bluerov2_survey")


def drawn(system: System, *parameters: Vary, **options: Any) -> Any:
    return Randomisation(parameters, system=system, **options).draw(DRAWS)


def test_a_draw_depends_on_seed_and_episode_alone(hold: System) -> None:
    r = published("bluerov2_heavy").bound(hold)
    whole = r.draw(Draws(np.arange(50), np.arange(50) % 3))
    for i in (0, 17, 49):
        alone = r.draw(Draws([i], [i % 3]))
        assert all(np.array_equal(alone[k][0], v[i]) for k, v in whole.items())


def test_one_more_parameter_leaves_the_others_as_they_were(hold: System) -> None:
    m = Vary("hull.m", Uniform(13.0, 14.0))
    both = drawn(hold, Vary("hull.z_b", Uniform(-0.02, -0.01)), m)
    np.testing.assert_array_equal(drawn(hold, m)["hull.m"], both["hull.m"])


def test_an_element_is_drawn_and_the_rest_of_its_vector_stays(hold: System) -> None:
    v_c = drawn(hold, Vary("hull.v_c[2]", Uniform(0.1, 0.2)))["hull.v_c"]
    assert v_c.shape == (N, 3)
    assert (v_c[:, 1] > 0.1).all()
    assert not v_c[:, [0, 2]].any()


def test_elements_and_instances_are_drawn_separately_or_together(hold: System) -> None:
    apart = drawn(hold, Vary("thruster_*.T_n", Uniform(0.02, 0.04)))
    same = drawn(hold, Vary("thruster_*.T_n", Uniform(0.02, 0.04), together=True))
    assert len(apart) == len(same) == 8
    assert (apart["thruster_1.T_n"] != apart["thruster_8.T_n"]).all()
    assert (same["thruster_1.T_n"] == same["thruster_8.T_n"]).all()
    Kp = drawn(hold, Vary("controller.Kp", Uniform(1.0, 2.0)))["controller.Kp"]
    assert (Kp[:, 0] != Kp[:, 1]).all()


def test_a_relative_draw_is_a_factor_on_the_systems_value(hold: System) -> None:
    Kp = drawn(hold, Vary("controller.Kp", Constant(1.5), relative=True))["controller.Kp"]
    np.testing.assert_allclose(Kp[0], 1.5 * np.array([80, 80, 110, 14, 14, 6]))


def test_units_are_converted_to_the_variables(hold: System) -> None:
    v_c = drawn(hold, Vary("hull.v_c[1]", Constant(3.6), unit="km/h"))["hull.v_c"]
    np.testing.assert_allclose(v_c[:, 0], 1.0)


def test_correlated_draws_keep_their_distributions_and_move_together(hold: System) -> None:
    n = 4000
    varies = [Vary("hull.m", Uniform(13.0, 14.0)), Vary("hull.z_b", Normal(-0.01, 0.001))]
    r = Randomisation(varies, [[1.0, 0.8], [0.8, 1.0]], hold)
    start = r.draw(Draws(np.arange(n), np.zeros(n, int)))
    z = (start["hull.z_b"] + 0.01) / 0.001
    assert np.corrcoef(start["hull.m"], z)[0, 1] == pytest.approx(0.8, abs=0.04)
    assert start["hull.m"].mean() == pytest.approx(13.5, abs=0.02)
    assert z.std() == pytest.approx(1.0, abs=0.05)


def test_a_correlation_of_one_ties_draws_exactly(hold: System) -> None:
    pair = {("hull.m", "hull.nabla"): 1.0}
    varies = [Vary("hull.m", Uniform(13.0, 14.0)), Vary("hull.nabla", Uniform(0.0130, 0.0140))]
    start = Randomisation(varies, pair, hold).draw(DRAWS)
    np.testing.assert_allclose(start["hull.m"] / 1000, start["hull.nabla"], rtol=1e-14)


@pytest.mark.parametrize(
    ("correlation", "says"),
    [
        (
            {("hull.m", "hull.zb"): 0.5},
            "'hull.zb' is not one draw; expected a parameter .* such as hull.z_b",
        ),
        ({("hull.m", "hull.z_b"): 1.5}, r"expected a number in \[-1, 1\]"),
        (
            {("hull.m", "hull.z_b"): 0.9, ("hull.m", "hull.g"): 0.9, ("hull.z_b", "hull.g"): -0.9},
            "positive semidefinite",
        ),
    ],
)
def test_a_correlation_that_cannot_be_is_refused(hold: System, correlation: Any, says: str) -> None:
    varies = [Vary(f"hull.{n}", Uniform(v, v + 1)) for n, v in (("m", 13), ("z_b", 0), ("g", 9))]
    with pytest.raises(SystemInvalid, match=says):
        Randomisation(varies, correlation, hold)


@pytest.mark.parametrize("matrix", [[[1.0]], [[1.0, 0.5], [0.4, 1.0]], [[2.0, 0.0], [0.0, 1.0]]])
def test_a_matrix_that_is_no_correlation_is_refused(matrix: Any) -> None:
    with pytest.raises(InputInvalid, match="correlation: "):
        Randomisation([Vary("a.b", Constant(1)), Vary("a.c", Constant(1))], matrix)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Vary("hull.m", "x"), r"hull.m: 'x'; expected a distribution, such as Uniform\("),  # type: ignore[arg-type]
        (lambda: Vary("hull.m", 13.0), r"such as Constant\(13.0\)"),  # type: ignore[arg-type]
        (lambda: Vary(3, Constant(1)), "name 3; expected a text"),  # type: ignore[arg-type]
        (lambda: Vary("hull.m", Constant(1), unit=1), "unit 1; expected a text"),  # type: ignore[arg-type]
        (lambda: Vary("hull.m", Constant(1), relative="x"), "relative 'x'; expected True"),  # type: ignore[arg-type]
        (lambda: Randomisation(["hull.m"]), "parameters: 'hull.m'; expected a Vary"),  # type: ignore[list-item]
        (lambda: Randomisation("hull.m"), "'hull.m'; expected a list of Vary"),  # type: ignore[arg-type]
        (lambda: Randomisation(Vary("a.b", Constant(1))), "expected a list of Vary"),  # type: ignore[arg-type]
        (lambda: Randomisation([], "x"), "correlation: 'x'; expected"),  # type: ignore[arg-type]
    ],
)
def test_what_is_no_randomisation_is_refused_in_a_sentence(
    make: Callable[[], object], says: str
) -> None:
    with pytest.raises(InputInvalid, match=says):
        make()


@pytest.mark.parametrize(
    ("vary", "says"),
    [
        (Vary("hul.m", Constant(1)), "such as hull"),
        (Vary("hull.mm", Constant(1)), "such as m"),
        (Vary("hull.m", Normal(13, 1)), r"\[-inf, inf\] kg; expected values in its range \[1e-09"),
        (Vary("hull.m", Uniform(-1, 1)), r"\[-1, 1\] kg"),
        (Vary("hull.eta", Constant(1)), "output; expected a parameter"),
        (Vary("hull.tau", Constant(1)), "is fed by wrench.tau"),
        (Vary("truster_*.T_n", Constant(1)), "no variable matches.*thruster_"),
        (Vary("hull.v_c[4]", Constant(1)), "indices from 1 to 3"),
        (Vary("hull.v_c", Uniform([1, 2], 3)), "over 2 elements; expected one over 3"),
        (Vary("hull.rho", Constant(1), unit="kg"), "'kg/m3' or a unit of its kind"),
        (Vary("guidance.count", Uniform(1, 3)), "Choice of whole numbers"),
    ],
)
def test_what_cannot_be_drawn_is_refused_before_anything_runs(
    hold: System, vary: Vary, says: str
) -> None:
    with pytest.raises(SystemInvalid, match=says):
        Randomisation([vary], system=hold)


def test_every_problem_is_listed_and_no_element_is_drawn_twice(hold: System) -> None:
    varies = [Vary("hull.mm", Constant(1)), Vary("hull.v_c", Constant(0)),
              Vary("hull.v_c[1]", Constant(1))]  # fmt: skip
    with pytest.raises(SystemInvalid, match=r"also drawn by 'hull\.v_c'") as refused:
        Randomisation(varies, system=hold)
    assert len(refused.value.problems) == 2


def test_impossible_bodies_are_drawn_again_and_counted(hold: System) -> None:
    r = Randomisation([Vary("hull.M_A_11", Uniform(-30.0, 30.0))], system=hold)
    start = r.draw(DRAWS)
    assert (start["hull.M_A_11"] > -13.5).all()
    assert r.rejected["hull"] > 20
    assert "drawn again" in r.remarks[0]


def test_distributions_without_a_possible_body_are_refused(hold: System) -> None:
    r = Randomisation([Vary("hull.M_A_11", Uniform(-30.0, -20.0))], system=hold)
    with pytest.raises(InputInvalid, match="no possible body"):
        r.draw(DRAWS)


def test_inertia_keeps_its_triangle_rule(hold: System) -> None:
    start = drawn(hold, Vary("hull.I_b_33", Uniform(0.01, 2.0)))
    assert start["hull.I_b_33"].min() >= 0.03
    assert start["hull.I_b_33"].max() <= 0.49


def test_privileged_numbers_are_scaled_by_their_ranges(hold: System) -> None:
    varies = [
        Vary("hull.m", Uniform(13.0, 14.0)),
        Vary("hull.z_b", Normal(-0.01, 0.001)),
        Vary("thruster_*.T_n", LogUniform(0.02, 0.04), together=True),
        Vary("hull.g", Constant(9.8)),
    ]
    r = Randomisation(varies, system=hold)
    start = r.draw(DRAWS)
    seen = r.privileged(start)
    assert r.privileged_names == ("hull.m", "hull.z_b", "thruster_*.T_n")
    assert seen.shape == (N, 3)
    np.testing.assert_allclose(seen[:, 0], 2 * (start["hull.m"] - 13) - 1)
    assert (np.abs(seen) <= 1).all()


class Hold(Task):
    def __init__(self, system: System, randomisation: Randomisation | None) -> None:
        super().__init__(
            system,
            actions=[Channel("hull.v_c", -1, 1)],
            observations=[Channel("hull.eta")],
            action_step="0.1",
            horizon="1",
            randomisation=randomisation,
        )

    def reward(self, m: Moment) -> Any:
        return np.zeros(m.n)


def test_a_task_binds_its_randomisation_and_refuses_what_does_not_fit(hold: System) -> None:
    task = Hold(hold, Randomisation([Vary("hull.m", Uniform(13, 14))]))
    assert task.start(DRAWS)["hull.m"].shape == (N,)
    with pytest.raises(SystemInvalid, match=r"hull\.mm"):
        Hold(hold, Randomisation([Vary("hull.mm", Uniform(13, 14))]))


def test_a_privileged_task_shows_what_it_draws(hold: System) -> None:
    task = with_privileged(Hold(hold, Randomisation([Vary("hull.m", Uniform(13, 14))])))
    start = task.start(DRAWS)

    class Now:
        n = N

        def __init__(self) -> None:
            self.start = start

    np.testing.assert_allclose(task.extra(Now())[:, 0], 2 * (start["hull.m"] - 13) - 1)  # type: ignore[arg-type]
    assert task.extra_limits == ([-1.0], [1.0])
    with pytest.raises(InputInvalid, match="draws nothing"):
        with_privileged(Hold(hold, None))


def test_a_privileged_team_sees_what_is_drawn_in_each_view_and_in_the_state() -> None:
    varies = [Vary("tracker_*.hull.m", Uniform(1.0, 1.1), relative=True, together=True)]
    plain = TargetTracking(2, 1, randomisation=Randomisation(varies))
    task = with_privileged(plain)
    assert task.privileged_width == 1
    team = CosimParallelEnv(task)
    try:
        seen, _ = team.reset(seed=4)
        assert team._simulation is not None
        m = team._simulation.now.moment.start["tracker_1.hull.m"]
        low, high = task.drawn.quantities[0].limits
        wanted = 2 * (m[0] - low) / (high - low) - 1
        assert abs(wanted) < 1
        for agent in task.agents:
            assert seen[agent][-1] == pytest.approx(wanted, abs=1e-6)
            assert len(seen[agent]) == len(plain.limits(agent)[0]) + 1
            assert team.observation_space(agent).contains(seen[agent])
        assert team.state()[-1] == pytest.approx(wanted, abs=1e-6)
        assert team.state_space.contains(team.state())
    finally:
        team.close()
    with pytest.raises(InputInvalid, match="TargetTracking: draws nothing"):
        with_privileged(TargetTracking(2))


def test_without_a_system_nothing_is_drawn() -> None:
    with pytest.raises(InputInvalid, match="belongs to no system"):
        Randomisation([Vary("hull.m", Constant(1))]).draw(DRAWS)


@pytest.mark.parametrize("name", ["bluerov2_heavy", "bluerov2_heavy@wu_2018"])
def test_published_intervals_hold_every_published_set(hold: System, name: str) -> None:
    system = hold.with_mismatches("warn").replace("hull", f"model:{name}")
    r = published(name).bound(system)
    start = r.draw(DRAWS)
    assert len(r.parameters) >= 20
    for set_ in vehicle_sets("bluerov2_heavy"):
        for key, q in parameter_set("bluerov2_heavy", set_).quantities.items():
            limits = [v.distribution.limits for v in r.parameters if v.name == f"hull.{key}"]
            if limits:
                assert limits[0][0] <= q.value <= limits[0][1]
    m, trim = ("hull.m", "hull.nabla") if name == "bluerov2_heavy" else ("hull.W", "hull.B")
    assert np.corrcoef(start[m], start[trim])[0, 1] == pytest.approx(1.0)


def test_published_values_of_a_set_are_those_of_its_parameter_file() -> None:
    data = read_yaml(content("models", "vehicles", "bluerov2_heavy", "published.yaml"),
                     "published.schema.json")  # fmt: skip
    for set_ in vehicle_sets("bluerov2_heavy"):
        for key, q in parameter_set("bluerov2_heavy", set_).quantities.items():
            if key in data["parameters"]:
                assert q.value in [v["value"] for v in data["parameters"][key]]


def test_an_unknown_vehicle_is_refused_with_those_that_are_published() -> None:
    with pytest.raises(InputInvalid, match="bluerov2_heavy"):
        published("bluerov")


def test_ready_made_sets_draw_noise_current_and_strength(hold: System, survey: System) -> None:
    r = sensor_noise(survey) + current(survey) + thruster_strength(survey)
    names = r.bound(survey).names
    assert {"imu.acc_noise_density", "dvl.sigma_v", "current.speed", "battery.soc_0"} <= {*names}
    assert not [n for n in names if n.startswith("navigation")]
    r = (current(hold, 0.4) + thruster_strength(hold)).bound(hold)
    start = r.draw(DRAWS)
    assert np.hypot(start["hull.v_c"][:, 0], start["hull.v_c"][:, 1]).max() <= 0.4
    assert (start["thruster_1.voltage"] == start["thruster_8.voltage"]).all()
    with pytest.raises(InputInvalid, match="no sensor with noise"):
        sensor_noise(hold)
    with pytest.raises(InputInvalid, match="no delay"):
        delays(hold)


def test_delays_of_links_are_drawn_up_to_what_a_link_allows() -> None:
    system = target_tracking(2, links=True)
    r = delays(system, 10.0).bound(system)
    links = ["positioning", *(f"tracker_{i}.{n}" for i in (1, 2) for n in ("radio", "positioning"))]
    assert sorted(r.names) == sorted(f"{link}.delay" for link in links)
    start = r.draw(DRAWS)
    assert all(v.min() >= 0.0 and 0.38 < v.max() <= 0.4 for v in start.values())
    task = TargetTracking(1, noise=0.01, randomisation=delays(target_tracking(1, links=True)))
    drawn_ = task.start(DRAWS)["positioning.delay"]
    assert drawn_.min() > 0.0
    assert 0.19 < drawn_.max() <= 0.2


def test_a_link_is_as_late_as_was_drawn(tmp_path: Path) -> None:
    system = System("s", "0.02").add("clock", "model:link?size=1&unit=s&period=0.02")
    grid = [Vary("clock.delay", Choice([0.0, 0.1, 0.2]))]
    metrics = {"late": "final(clock.t_sample)"}
    rows = Study(system, duration="1", metrics=metrics, grid=grid).run(tmp_path / "s").table()
    assert rows["late"].to_pylist() == pytest.approx([0.98, 0.88, 0.78])


def test_a_file_says_the_same_as_python(hold: System, tmp_path: Path) -> None:
    file = tmp_path / "r.yaml"
    file.write_text(
        "parameters:\n"
        "  hull.m: {uniform: [13, 14]}\n"
        "  hull.v_c[1]: {choice: [0, 1], unit: km/h}\n"
        "  thruster_*.T_n: {log_uniform: {low: 0.5, high: 2}, relative: true, together: true}\n"
        "  hull.z_b: {normal: {mean: -0.01, std: 0.001, max: 0}}\n"
        "  hull.g: 9.81\n"
        "correlation:\n"
        "  - {between: [hull.m, hull.z_b], value: 0.5}\n"
    )
    read = Randomisation.read(file, hold)
    kinds: list[tuple[str, Distribution, dict[str, Any]]] = [
        ("hull.m", Uniform(13, 14), {}),
        ("hull.v_c[1]", Choice([0, 1]), {"unit": "km/h"}),
        ("thruster_*.T_n", LogUniform(0.5, 2), {"relative": True, "together": True}),
        ("hull.z_b", Normal(-0.01, 0.001, max=0), {}),
        ("hull.g", Constant(9.81), {}),
    ]
    assert read.parameters == tuple(Vary(n, d, **o) for n, d, o in kinds)
    assert read.correlation == {("hull.m", "hull.z_b"): 0.5}


def test_a_broken_file_is_refused_with_every_line(hold: System, tmp_path: Path) -> None:
    file = tmp_path / "r.yaml"
    file.write_text(
        "parameters:\n"
        "  hull.m: {uniform: [14, 12]}\n"
        "  hull.mm: {uniform: [1, 2]}\n"
        "  hull.nabla: {unifrm: [1, 2]}\n"
        "  hull.rho: {constant: 1025, unit: 5}\n"
        "sets:\n"
        "  - sensr_noise\n"
        "  - {set: published, vehicle: bluerov, prefx: hull}\n"
        "correlation:\n"
        "  - {between: [hull.m], value: 1}\n"
    )
    with pytest.raises(InputInvalid) as refused:
        Randomisation.read(file, hold)
    said = str(refused.value)
    for line, words in {2: "low not above high", 3: "such as m", 4: "such as uniform",
                        5: "expected the name of a unit", 7: "sensor_noise", 8: "prefix",
                        10: "two names"}.items():  # fmt: skip
        assert any(f"r.yaml:{line}:" in s and words in s for s in said.splitlines()), (line, said)
