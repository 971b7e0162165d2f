"""Contact with seabed, obstacles and other vehicles: stiffness bounded, energy never won."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.errors import InputInvalid, ParameterInvalid
from uuvsim_cosim.fmus.native import Native
from uuvsim_cosim.models.contact import KAPPA, LEAD, balls_of, stiffness
from uuvsim_cosim.models.controller import nominal
from uuvsim_cosim.models.ground import ground_named
from uuvsim_cosim.models.library import declare
from uuvsim_cosim.models.obstacles import Box, Sphere
from uuvsim_cosim.models.parameters import vehicle_size
from uuvsim_cosim.models.rays import Touch
from uuvsim_cosim.models.scene import Scene, save_scene
from uuvsim_cosim.models.terrain import Terrain, save_terrain

H = 0.02


def felt(native: Native, **values: Any) -> dict[str, Any]:
    variables = native.description.variables
    for name, value in values.items():
        native.set(variables[name], np.asarray(value, float))
    return {n: native.get(v) for n, v in variables.items() if v.causality == "output"}


def made(**options: Any) -> Native:
    native = Native(declare("contact", **options), "contact")
    native.enter_initialization_mode(0.0, None)
    native.exit_initialization_mode()
    return native


@pytest.fixture(scope="module")
def bumpy(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A rough, sloping bed with a wall and a ball."""
    rng = np.random.default_rng(5)
    x = 0.5 * np.arange(60)
    z = 12.0 + 0.3 * x[:, None] - 0.2 * x[None, :] + 0.25 * rng.normal(size=(60, 60))
    terrain = Terrain(z.astype(np.float32), 0.5, (-15.0, -15.0))
    folder: Path = tmp_path_factory.mktemp("bumpy")
    solids = (Box((6, 0, 10), (0.5, 5, 4)), Sphere((-4, 0, 10), 1.5))
    save_scene(Scene("bumpy", terrain, solids, None, "rough slope", "made up"), folder)
    return str(folder)


@pytest.fixture(scope="module")
def sphere(bumpy: str) -> Native:
    return made(vehicle="sphere", scene=bumpy, step=H)


# ---- the law ----------------------------------------------------------------------------------


def test_free_water_does_not_push() -> None:
    out = felt(made(), eta=[0, 0, 20, 0.2, 0.1, 0], nu=[0.5, 0.2, 0.3, 0, 0, 0.4])
    np.testing.assert_array_equal(out["tau"], 0.0)
    assert out["depth"] == 0.0
    assert out["over_terrain"]


def test_outside_of_the_terrain_there_is_no_bed_and_it_is_said() -> None:
    out = felt(made(), eta=[2e4, 0, 40, 0, 0, 0])
    np.testing.assert_array_equal(out["tau"], 0.0)
    assert not out["over_terrain"]


def test_a_level_hull_on_a_level_bed_feels_four_corners_and_no_moment() -> None:
    K = declare("contact").variables["K"].start[0]
    out = felt(made(), eta=[0, 0, 25.0 - 0.127 + 0.01, 0, 0, 0])
    np.testing.assert_allclose(out["tau"], [0, 0, -4 * K * 0.01, 0, 0, 0], atol=1e-9)
    assert out["depth"] == pytest.approx(0.01, abs=1e-12)


def test_a_corner_that_touches_turns_the_hull() -> None:
    out = felt(made(), eta=[0, 0, 24.8, 0.3, 0.2, 0], q=_q(0.3, 0.2))
    assert out["depth"] > 0.0
    # phi, theta > 0: the starboard, after, lower corner is the deepest
    assert out["tau"][3] < 0.0
    assert out["tau"][4] < 0.0


def test_another_vehicle_pushes_away_from_its_axis_and_more_if_it_comes_nearer() -> None:
    native = made(vehicle="sphere", others=1, step=H)
    at = {"eta": [0, 0, 10, 0, 0, 0], "other_eta_1": [0.35, 0, 10, 0, 0, np.pi / 2]}
    assert not np.any(felt(native, **at)["tau"])  # of no size
    still = felt(native, **at, other_size=[[0.2, 0.5]])
    K = declare("contact", vehicle="sphere", step=H).variables["K"].start[0]
    np.testing.assert_allclose(still["tau"], [-0.05 * K, 0, 0, 0, 0, 0], atol=1e-9)
    coming = felt(native, other_nu_1=[0, 0.1, 0, 0, 0, 0])  # its starboard is south
    assert coming["tau"][0] == pytest.approx(-(0.05 + LEAD * H * 0.1) * K)


def test_the_force_is_the_same_wherever_the_bed_is_cut(tmp_path: Path) -> None:
    fine, coarse = tmp_path / "fine.npz", tmp_path / "coarse.npz"
    for file, h, n in ((fine, 0.25, 161), (coarse, 20.0, 3)):
        x = h * (np.arange(n) - (n - 1) / 2)
        save_terrain(
            Terrain((10 + 0.5 * x[:, None] + 0 * x).astype(np.float32), h, (x[0],) * 2), file
        )
    rng = np.random.default_rng(0)
    f, c = (Touch("t", ground_named(str(file)), 0) for file in (fine, coarse))
    for _ in range(30):
        p = np.array([*rng.uniform(-1, 1, 2), 0.0])
        p[2] = 10 + 0.5 * p[0] + rng.uniform(-0.1, 0.3)
        x = np.array([*p, *rng.normal(size=3), 100.0, 12.0, 0.1])
        np.testing.assert_allclose(f(x), c(x), atol=1e-9)


def test_the_survey_of_the_page_that_dives_onto_the_charted_bed_is_held_by_it() -> None:
    """The page's own lines: they give a system whose vehicle, told to go deeper, stays."""
    from uuvsim_cosim.content import content
    from uuvsim_cosim.kernels.kernel import fuse
    from uuvsim_cosim.scene.cast import Caster

    page = (content("docs") / "range_sensors.md").read_text(encoding="utf-8")
    (code,) = [c for c in page.split("```python\n") if "def with_contact" in c]
    names: dict[str, Any] = {}
    exec(code.partition("```")[0], names)
    with fuse(names["system"]).batch(1) as batch:
        batch.step(2500)
        eta, depth = batch.get("hull.eta")[0], float(batch.get("contact.depth")[0])
    bed = float(Caster("tacoma").height(eta[0], eta[1]))
    assert 0.05 < depth < 0.2
    assert bed - 0.2 < eta[2] < bed + 0.1


# ---- the bound --------------------------------------------------------------------------------


@pytest.mark.parametrize("vehicle", ["bluerov2_heavy", "remus100", "sphere", "rexrov2"])
def test_the_stiffness_is_within_the_bound_and_close_to_it(vehicle: str) -> None:
    size = vehicle_size(vehicle)
    assert size is not None
    r, _ = balls_of(size)
    K = stiffness(vehicle, r, H)
    S = np.array([[[0, -c, b], [c, 0, -a], [-b, a, 0]] for a, b, c in r])
    J = np.concatenate([np.tile(np.eye(3), (len(r), 1, 1)), -S], axis=2)
    M = np.diag(nominal(vehicle)[0])
    largest = np.max(np.linalg.eigvals(np.linalg.inv(M) @ np.einsum("kij,kil->jl", J, J)).real)
    assert 0.9 * KAPPA < K * H**2 * largest <= KAPPA * (1 + 1e-9)


def test_half_the_step_allows_four_times_the_stiffness() -> None:
    r = np.zeros((1, 3))
    assert stiffness("sphere", r, H / 2) == pytest.approx(4 * stiffness("sphere", r, H), rel=0.1)


def test_no_delayed_force_of_this_stiffness_gains_energy_in_any_phase() -> None:
    """One degree of freedom of unit mass and step, forces two steps late, up to kappa = 0.22."""
    phase = np.linspace(0, 1, 400, endpoint=False)
    for kappa in (0.005, 0.05, KAPPA, 0.22):
        d, v = -(LEAD + 6) - phase, np.ones(400)
        seen = [(d, v)] * 3
        for _ in range(250):
            then, speed = seen[-3]
            f = np.maximum(0.0, kappa * (then + LEAD * speed))
            d, v = d + v - 0.5 * f, v - f
            seen.append((d, v))
            assert np.all(0.5 * v**2 + 0.5 * kappa * np.maximum(d, 0) ** 2 <= 0.5 + 1e-12)


def test_a_stiffness_beyond_the_bound_is_refused() -> None:
    native = made(vehicle="sphere")
    K = native.description.variables["K"]
    with pytest.raises(Exception, match=r"expected finite numbers in \[0"):
        native.set(K, 1.01 * declare("contact", vehicle="sphere").variables["K"].start[0])


# ---- energy -----------------------------------------------------------------------------------


def dropped(native: Native, p: Any, v: Any, delay: int) -> tuple[Any, Any, float]:
    """Drop a ball of the sphere's mass and a weight in water; give energies and greatest depth.

    Energies are kinetic with gravity's, and the same with the spring's, less those at the start.
    """
    mass = min(nominal("sphere")[0][:3])
    K = declare("contact", vehicle="sphere", step=H).variables["K"].start[0]
    g, late, rows, depth = 0.5, [np.zeros(3)] * delay, [], 0.0  # m/s²
    p, v = np.array(p, float), np.array(v, float)
    for _ in range(1000):
        out = felt(native, eta=[*p, 0, 0, 0], nu=[*v, 0, 0, 0])
        energy = 0.5 * mass * v @ v - mass * g * p[2]
        rows.append((energy, energy + 0.5 * K * out["depth"] ** 2))
        depth = max(depth, float(out["depth"]))
        late.append(out["tau"][:3])
        a = late.pop(0) / mass + np.array([0, 0, g])
        p, v = p + H * v + 0.5 * H * H * a, v + H * a
        if max(abs(p[0]), abs(p[1])) > 12:
            break
    energies = np.array(rows)
    return energies[:, 0] - energies[0, 0], energies[:, 1] - energies[0, 0], depth


@pytest.mark.parametrize("v", [(0, 0, 0.5), (1.0, 0.3, 0.5), (-0.8, 0.6, 0.2)])
@pytest.mark.parametrize("slope", [0.0, 0.5])
def test_a_ball_dropped_on_a_plane_never_has_more_energy_than_at_the_start(
    tmp_path: Path, slope: float, v: Any
) -> None:
    x = np.array([-15.0, 15.0])
    file = tmp_path / f"plane_{slope:g}.npz"
    z = 10.0 + slope * x[:, None] + 0.0 * x[None, :]
    save_terrain(Terrain(z.astype(np.float32), 30.0, (-15.0, -15.0)), file)
    native = made(vehicle="sphere", scene=str(file), step=H)
    for delay in (1, 2):
        _, total, depth = dropped(native, (0, 0, 8.5), v, delay)
        assert depth > 0.01
        assert np.max(total) <= 1e-9


@pytest.mark.parametrize("seed", range(6))
def test_on_a_rough_slope_with_walls_a_ball_is_never_faster_than_its_fall_allows(
    sphere: Native, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    p, v = [*rng.uniform(-3, 3, 2), 6.0], [*rng.uniform(-1, 1, 2), 0.5]
    mechanical, _, depth = dropped(sphere, p, v, 2)
    assert depth > 0.01
    assert np.max(mechanical) <= 1e-9


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"step": 0}, "step = 0"),
        ({"scene": "nowhere"}, "there is no scene 'nowhere'"),
        ({"others": 99}, "others = 99; expected 0 to 64"),
    ],
)
def test_wrong_options_are_said(options: Any, words: str) -> None:
    with pytest.raises((ParameterInvalid, InputInvalid), match=words):
        declare("contact", **options)


def _q(phi: float, theta: float) -> Any:
    import casadi as ca

    from uuvsim_cosim.models.kinematics import q_of_euler

    return np.array(ca.DM(q_of_euler(phi, theta, 0))).ravel()
