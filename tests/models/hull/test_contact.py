"""Contact with seabed, obstacles and other vehicles: what touches, how it pushes, how it rubs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from uuvsim_cosim.errors import InputInvalid, ParameterInvalid
from uuvsim_cosim.fmus.codegen.lowering import lower
from uuvsim_cosim.fmus.codegen.native import Native
from uuvsim_cosim.fmus.export.fmu_file import build_fmu
from uuvsim_cosim.fmus.importer.fmu3 import Fmu3
from uuvsim_cosim.fmus.importer.read_description import read_fmu
from uuvsim_cosim.models.declaration.kinematics import R, q_of_euler
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.hull.contact import FRICTION, KAPPA, MU, HullContact
from uuvsim_cosim.models.hull.contact_reference import GRIP, LATE, LEAD
from uuvsim_cosim.models.hull.matrices import nominal
from uuvsim_cosim.models.intrinsics.network import NETWORKS
from uuvsim_cosim.models.worlds.obstacles import Box, Capsule, Cylinder, Obstacle, Sphere
from uuvsim_cosim.models.worlds.scene import Scene, load_scene, save_scene
from uuvsim_cosim.models.worlds.terrain import Terrain, save_terrain

H = 0.02
BOW = 0.457 / 2  # m, of bluerov2_heavy from CO


def q_of(attitude: Any) -> Any:
    return np.array(ca.DM(q_of_euler(*attitude))).ravel()


def felt(native: Native, **values: Any) -> dict[str, Any]:
    variables = native.description.variables
    if "eta" in values and "q" not in values:
        values["q"] = q_of(np.asarray(values["eta"], float)[3:])
    for name, value in values.items():
        native.set(variables[name], np.asarray(value, float))
    return {n: native.get(v) for n, v in variables.items() if v.causality == "output"}


def made(**options: Any) -> Native:
    native = Native(declare("contact", **options), "contact")
    native.enter_initialization_mode(0.0, None)
    native.exit_initialization_mode()
    return native


def stiffness(vehicle: str, axis: int, h: float = H) -> float:
    """K of a push through CO along an axis of b [N/m]."""
    return KAPPA * nominal(vehicle)[0][axis] / h**2


def among(folder: Path, *obstacles: Obstacle, terrain: Terrain | None = None) -> str:
    save_scene(Scene(folder.name, terrain, obstacles, None, "a place", "made up"), folder)
    return str(folder)


@pytest.fixture(scope="module")
def bumpy(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A rough, sloping bed with a solid of each kind."""
    rng = np.random.default_rng(5)
    x = 1.5 * np.arange(20)
    z = 12.0 + 0.3 * x[:, None] - 0.2 * x[None, :] + 0.4 * rng.normal(size=(20, 20))
    terrain = Terrain(z.astype(np.float32), 1.5, (-15.0, -15.0))
    solids = (
        Box((3, 0, 10), (0.1, 5, 4), 0.4),
        Sphere((-4, 0, 10), 1.5),
        Cylinder((0, 3, 10), 0.25, 6),
        Capsule((-3, -5, 11), (3, -6, 9), 0.3),
    )
    return among(tmp_path_factory.mktemp("bumpy"), *solids, terrain=terrain)


# ---- what touches -----------------------------------------------------------------------------


def test_free_water_does_not_push() -> None:
    out = felt(made(), eta=[0, 0, 20, 0.2, 0.1, 0], nu=[0.5, 0.2, 0.3, 0, 0, 0.4])
    np.testing.assert_array_equal(out["tau"], 0.0)
    assert out["depth"] == 0.0
    assert out["touched"] == -1
    assert out["over_terrain"]


def test_outside_of_the_terrain_there_is_no_bed_and_it_is_said() -> None:
    out = felt(made(), eta=[2e4, 0, 40, 0, 0, 0])
    np.testing.assert_array_equal(out["tau"], 0.0)
    assert not out["over_terrain"]


def test_a_level_hull_on_a_level_bed_is_pushed_up_and_not_turned() -> None:
    out = felt(made(step=H), eta=[0, 0, 25.0 - 0.127 + 0.01, 0, 0, 0])
    up = -0.01 * stiffness("bluerov2_heavy", 2)
    np.testing.assert_allclose(out["tau"], [0, 0, up, 0, 0, 0], rtol=0.04, atol=1e-4)
    assert out["depth"] == pytest.approx(0.01, abs=1e-12)
    assert out["touched"] == 0


def test_a_corner_that_touches_turns_the_hull() -> None:
    out = felt(made(), eta=[0, 0, 24.8, 0.3, 0.2, 0])
    assert out["depth"] > 0.0
    # phi, theta > 0: the starboard, after, lower corner is the deepest
    assert out["tau"][3] < 0.0
    assert out["tau"][4] < 0.0


@pytest.mark.parametrize(
    "obstacle",
    [
        Box((1.1, 0, 10), (0.1, 4, 4)),  # a wall of 0.2 m
        Box((1.005, 0, 10), (0.005, 4, 4)),  # of 0.01 m
        Cylinder((1.25, 0, 10), 0.25, 4),  # a pile of 0.5 m, between all corners
        Cylinder((1.01, 0, 10), 0.01, 4),  # of 0.02 m
        Box((1 + 0.2 * np.sqrt(2), 0, 10), (0.2, 0.2, 4), np.pi / 4),  # its edge
        Capsule((1.05, -3, 10), (1.05, 3, 10), 0.05),
        Sphere((1.2, 0, 10), 0.2),
    ],
    ids=lambda o: f"{type(o).__name__}",
)
def test_what_meets_the_middle_of_a_face_pushes_it_back(tmp_path: Path, obstacle: Any) -> None:
    native = made(scene=among(tmp_path, obstacle), step=H)
    for d in (0.02, 0.002):
        out = felt(native, eta=[1 - BOW + d, 0, 10, 0, 0, 0])
        assert out["depth"] == pytest.approx(d, abs=1e-9)
        assert out["touched"] == 1
        back = -d * stiffness("bluerov2_heavy", 0)
        np.testing.assert_allclose(out["tau"], [back, 0, 0, 0, 0, 0], rtol=0.06, atol=1e-3)


def test_two_edges_that_cross_push_apart(tmp_path: Path) -> None:
    """The lower edge of a hull on its side crosses the upper one of a box, far from all corners."""
    box = Box((0, 0, 10 + np.sqrt(0.5)), (5, 0.5, 0.5))
    native = made(vehicle="desistek_saga", scene=among(tmp_path, box), step=H)
    # rolled by 45 degrees over an edge along N, yawed across it
    breadth, height = 0.2384, 0.28066
    down = (breadth + height) / 2 * np.sqrt(0.5)
    top = 10 + np.sqrt(0.5) - 0.5
    out = felt(native, eta=[0, 0.5, top - down + 0.01, np.pi / 4, 0, np.pi / 2])
    assert out["depth"] == pytest.approx(0.01, abs=2e-3)
    assert (np.array(ca.DM(R(ca.DM(q_of([np.pi / 4, 0, np.pi / 2]))))) @ out["tau"][:3])[2] < 0.0


@pytest.mark.parametrize("vehicle", ["bluerov2_heavy", "lauv"])
def test_a_ridge_of_the_seabed_bears_a_hull_between_its_corners(
    tmp_path: Path, vehicle: str
) -> None:
    z = np.full((5, 5), 30.0)
    z[2] = 10.0  # a ridge along E through N = 0
    file = tmp_path / "ridge.npz"
    save_terrain(Terrain(z.astype(np.float32), 5.0, (-10.0, -10.0)), file)
    half = {"bluerov2_heavy": 0.127, "lauv": 0.075}[vehicle]
    out = felt(made(vehicle=vehicle, scene=str(file), step=H), eta=[0, 0.3, 10.01 - half, 0, 0, 0])
    assert out["depth"] == pytest.approx(0.01, abs=1e-6)
    up = -0.01 * stiffness(vehicle, 2)
    np.testing.assert_allclose(out["tau"], [0, 0, up, 0, 0, 0], rtol=0.06, atol=2e-2)


def test_a_hull_in_a_gap_too_narrow_is_centred(tmp_path: Path) -> None:
    walls = [Box((side * (BOW - 0.02 + 0.1), 0, 10), (0.1, 4, 4)) for side in (-1, 1)]
    native = made(scene=among(tmp_path, *walls), step=H)
    middle = felt(native, eta=[0, 0, 10, 0, 0, 0])
    assert np.abs(middle["tau"]).max() < 1e-6
    ahead = felt(native, eta=[0.01, 0, 10, 0, 0, 0])
    assert -1.1 * 0.01 * stiffness("bluerov2_heavy", 0) < ahead["tau"][0] < 0.0


@pytest.mark.parametrize("side", [0.30, 0.35])
def test_what_passes_beside_a_pile_is_not_pushed(tmp_path: Path, side: float) -> None:
    pile = Cylinder((0, side + 0.25, 10), 0.25, 4)
    native = made(scene=among(tmp_path, pile), step=H)  # half a breadth: 0.2875 m
    for north in np.linspace(-1.5, 1.5, 61):
        out = felt(native, eta=[north, 0, 10, 0, 0, 0], nu=[2, 0, 0, 0, 0, 0])
        np.testing.assert_array_equal(out["tau"], 0.0)


def test_what_will_hit_a_thin_wall_is_braked_before_it(tmp_path: Path) -> None:
    native = made(scene=among(tmp_path, Box((1, 0, 10), (0.005, 4, 4))), step=H)
    ahead = LEAD * H * 2.0
    for gap, braked in ((1.05 * ahead, False), (0.95 * ahead, True), (0.2 * ahead, True)):
        out = felt(native, eta=[0.995 - BOW - gap, 0, 10, 0, 0, 0], nu=[2, 0, 0, 0, 0, 0])
        assert (out["tau"][0] < 0.0) == braked
        assert out["depth"] == 0.0


def test_another_vehicle_pushes_away_from_its_axis_and_more_if_it_comes_nearer() -> None:
    native = made(vehicle="sphere", others=1, step=H)
    at = {"eta": [0, 0, 10, 0, 0, 0], "other_eta_1": [0.35, 0, 10, 0, 0, np.pi / 2]}
    assert not np.any(felt(native, **at)["tau"])  # of no size
    still = felt(native, **at, other_size=[[0.2, 0.5]])
    K = stiffness("sphere", 0) / 1.05
    np.testing.assert_allclose(still["tau"], [-0.05 * K, 0, 0, 0, 0, 0], atol=1e-6)
    assert still["touched"] == 1
    coming = felt(native, other_nu_1=[0, 0.1, 0, 0, 0, 0])  # its starboard is south
    assert coming["tau"][0] == pytest.approx(-(0.05 + LEAD * H * 0.1) * K)


def test_the_force_is_the_same_wherever_the_bed_is_cut(tmp_path: Path) -> None:
    files = []
    for h, n in ((0.25, 161), (20.0, 3)):
        x = h * (np.arange(n) - (n - 1) / 2)
        files.append(tmp_path / f"{n}.npz")
        z = (10 + 0.5 * x[:, None] + 0 * x).astype(np.float32)
        save_terrain(Terrain(z, h, (x[0],) * 2), files[-1])
    fine, coarse = (made(vehicle="sphere", scene=str(f), step=H) for f in files)
    rng = np.random.default_rng(0)
    for _ in range(30):
        p = np.array([*rng.uniform(-1, 1, 2), 0.0, 0, 0, 0])
        p[2] = 10 + 0.5 * p[0] - 0.2 + rng.uniform(-0.1, 0.2)
        nu = rng.normal(size=6)
        f, c = felt(fine, eta=p, nu=nu), felt(coarse, eta=p, nu=nu)
        np.testing.assert_allclose(f["tau"], c["tau"], atol=1e-6)


# ---- the law ----------------------------------------------------------------------------------


@pytest.mark.parametrize("vehicle", ["bluerov2_heavy", "lauv", "rexrov2"])
def test_no_direction_is_stiffer_than_the_bound(bumpy: str, vehicle: str) -> None:
    """However many points touch: the eigenvalues of M^-1 d tau / d pose, where it is smooth."""
    native, rng = made(vehicle=vehicle, scene=bumpy, step=H), np.random.default_rng(2)
    M, e, checked = np.array(nominal(vehicle)[0]), 1e-6, 0
    for _ in range(900):
        p, turn = [*rng.uniform(-5, 5, 2), rng.uniform(8, 13)], rng.uniform(-1, 1, 3)
        if not 0.0 < felt(native, eta=[*p, *turn], nu=np.zeros(6))["depth"] < 0.02:
            continue
        q = q_of(turn)
        Rnb = np.array(ca.DM(R(ca.DM(q))))
        columns = []
        for k in range(6):
            pair = []
            for sign in (e, -e):
                d = np.zeros(6)
                d[k] = sign
                spun = np.concatenate([[1.0], d[3:] / 2])
                turned = np.array(ca.DM(_product(q, spun))).ravel()
                pair.append(felt(native, eta=[*(p + Rnb @ d[:3]), *turn], q=turned)["tau"])
            columns.append((pair[0] - pair[1]) / (2 * e))
        scaled = -np.array(columns).T / np.sqrt(np.outer(M, M)) * H**2
        symmetric = np.linalg.eigvalsh(0.5 * (scaled + scaled.T))
        if np.abs(scaled - scaled.T).max() < 0.1 * KAPPA:  # else a point appears within e
            assert symmetric[-1] < KAPPA * 1.15  # poses bend
            checked += 1
    assert checked >= 3


def _product(a: Any, b: Any) -> Any:
    w, v, u, x = a[0], ca.DM(a[1:]), b[0], ca.DM(b[1:])
    return ca.vertcat(w * u - ca.dot(v, x), w * x + u * v + ca.cross(v, x))


def test_a_push_through_the_middle_scales_with_mass_and_step() -> None:
    for vehicle, half in (("bluerov2_heavy", 0.127), ("rexrov2", 0.8), ("sphere", 0.2)):
        for h in (0.01, 0.05):
            out = felt(made(vehicle=vehicle, step=h), eta=[0, 0, 25.001 - half, 0, 0, 0])
            assert -out["tau"][2] / 0.001 == pytest.approx(stiffness(vehicle, 2, h), rel=0.06)


def test_no_delayed_force_of_this_stiffness_gains_energy_in_any_phase() -> None:
    """One degree of freedom of unit mass and step, forces two steps late, up to kappa = 0.14."""
    phase = np.linspace(0, 1, 400, endpoint=False)
    for kappa in (0.005, KAPPA, 0.14):
        d, v = -(LEAD + 6) - phase, np.ones(400)
        seen = [(d, v)] * 3
        for _ in range(250):
            then, speed = seen[-3]
            f = np.maximum(0.0, kappa * (then + LEAD * speed))
            d, v = d + v - 0.5 * f, v - f
            seen.append((d, v))
            assert np.all(0.5 * v**2 + 0.5 * kappa * np.maximum(d, 0) ** 2 <= 0.5 + 1e-12)


def test_what_is_seen_at_the_last_moment_does_not_leave_faster_than_it_came() -> None:
    """A solid that appears, as behind an edge: the force begins at full speed."""
    for first in np.linspace(-3.0, 0.0, 31):
        d, v, forces = first, 1.0, [0.0, 0.0]
        for _ in range(250):
            forces.append(max(0.0, KAPPA * (d + LEAD * v)))
            f = forces[-3]
            d, v = d + v - 0.5 * f, v - f
            assert v >= -0.63


def test_the_c_agrees_with_the_reference_in_numpy(bumpy: str) -> None:
    rng = np.random.default_rng(7)
    for vehicle in ("bluerov2_heavy", "lauv", "sphere"):
        native = made(vehicle=vehicle, scene=bumpy, step=H)
        outputs = lower(declare("contact", vehicle=vehicle, scene=bumpy, step=H)).equations.outputs
        called = [NETWORKS.get(g.name()) for g in outputs.find_functions()]
        (reference,) = [n for n in called if isinstance(n, HullContact)]
        touched = 0
        for _ in range(150):
            eta = np.array([*rng.uniform(-5, 5, 2), rng.uniform(9, 12), *rng.uniform(-1, 1, 3)])
            nu, q = rng.normal(size=6), q_of(eta[3:])
            out = felt(native, eta=eta, q=q, nu=nu)
            rotation = np.array(ca.DM(R(ca.DM(q)))).ravel()
            M = nominal(vehicle)[0]
            y = reference(np.array([*eta[:3], *rotation, *nu, *M, H, KAPPA, MU, *np.zeros(4)]))
            given = [*out["tau"], out["depth"], out["touched"]]
            np.testing.assert_allclose(given, y, rtol=1e-6, atol=1e-6)
            touched += out["depth"] > 0
        assert touched > 10


def test_an_fmu_has_the_bits_of_the_native_component(bumpy: str) -> None:
    model = declare("contact", vehicle="bluerov2_heavy", scene=bumpy, step=H)
    native, fmu = Native(model, "contact"), Fmu3(read_fmu(build_fmu(model, fmi=3)), "contact")
    try:
        for each in (native, fmu):
            each.enter_initialization_mode(0.0, None)
            each.exit_initialization_mode()
        rng, touched = np.random.default_rng(3), 0
        for _ in range(200):
            eta = np.array([*rng.uniform(-5, 5, 2), rng.uniform(9, 12), *rng.uniform(-1, 1, 3)])
            values = {"eta": eta, "q": q_of(eta[3:]), "nu": rng.normal(size=6)}
            outs = []
            for each in (native, fmu):
                variables = each.description.variables
                for name, value in values.items():
                    each.set(variables[name], value)
                outs.append([each.get(variables[n]) for n in ("tau", "depth", "touched")])
            np.testing.assert_array_equal(outs[0][0], outs[1][0])
            assert outs[0][1:] == outs[1][1:]
            touched += outs[0][1] > 0
        assert touched > 10
    finally:
        fmu.free()


def test_a_stiffness_beyond_the_bound_is_refused() -> None:
    native = made(vehicle="sphere")
    with pytest.raises(Exception, match=r"expected finite numbers in \[0"):
        native.set(native.description.variables["kappa"], 1.01 * KAPPA)


# ---- friction ---------------------------------------------------------------------------------


def test_a_hull_that_slides_feels_the_coefficient_times_the_normal_force() -> None:
    out = felt(made(step=H), eta=[0, 0, 25.02 - 0.127, 0, 0, 0], nu=[0.8, 0.6, 0, 0, 0, 0])
    normal = -out["tau"][2]
    np.testing.assert_allclose(out["tau"][:2], [-MU * 0.8 * normal, -MU * 0.6 * normal], rtol=1e-6)
    native = made(step=H)
    none = felt(native, eta=[0, 0, 25.02 - 0.127, 0, 0, 0], nu=[0.8, 0.6, 0, 0, 0, 0], mu=0.0)
    np.testing.assert_allclose(none["tau"][:2], 0.0, atol=1e-9)


def test_slow_slip_is_braked_in_proportion_and_within_the_bound() -> None:
    mass = nominal("sphere")[0]
    M, way = mass[0], 1.0 / mass[0] + 0.2**2 / mass[4]  # a ball rolls as well
    out = felt(
        made(vehicle="sphere", step=H), eta=[0, 0, 25.02 - 0.2, 0, 0, 0], nu=[1e-3, 0, 0, 0, 0, 0]
    )
    share = -out["tau"][0] * H / (M * 1e-3)  # of the momentum, in a step
    assert share == pytest.approx(GRIP / (M * way), rel=0.15)


def test_friction_never_pushes_along_the_slip(bumpy: str) -> None:
    rubbed, smooth = (made(scene=bumpy, step=H) for _ in range(2))
    rng, seen = np.random.default_rng(4), 0
    for _ in range(300):
        eta = np.array([*rng.uniform(-5, 5, 2), rng.uniform(9, 12), *rng.uniform(-1, 1, 3)])
        nu = np.array([*rng.normal(size=3), 0, 0, 0])
        with_it = felt(rubbed, eta=eta, nu=nu)["tau"]
        without = felt(smooth, eta=eta, nu=nu, mu=0.0)["tau"]
        assert (with_it - without) @ nu <= 1e-9
        seen += bool(np.any(with_it != without))
    assert seen > 10


def test_a_seabed_of_mud_rubs_less_than_one_of_gravel(tmp_path: Path) -> None:
    found = {}
    for material in ("mud", "sand", "gravel", "unheard of"):
        file = tmp_path / f"{material}.npz"
        z, index = np.full((3, 3), 25.0, np.float32), np.ones((3, 3), np.uint8)
        names = ("", material)
        save_terrain(Terrain(z, 10.0, (-10.0, -10.0), material=index, materials=names), file)
        tau = felt(
            made(scene=str(file), step=H), eta=[0, 0, 24.893, 0, 0, 0], nu=[1, 0, 0, 0, 0, 0]
        )["tau"]
        found[material] = tau[0] / tau[2]
    for material, ratio in found.items():
        assert ratio == pytest.approx(FRICTION.get(material, MU), rel=1e-6)


def test_an_obstacle_that_states_its_friction_rubs_with_that(tmp_path: Path) -> None:
    for stated, mu, wanted in ((None, MU, MU), (0.6, MU, 0.6), (0.0, MU, 0.0), (0.6, 0.1, 0.2)):
        folder = tmp_path / f"{stated}_{mu}"
        scene = among(folder, Box((0, 0, 30), (9, 9, 5), friction=stated))
        assert load_scene(folder).obstacles[0].friction == stated
        tau = felt(
            made(scene=scene, step=H), eta=[0, 0, 24.893, 0, 0, 0], nu=[1, 0, 0, 0, 0, 0], mu=mu
        )["tau"]
        assert tau[0] / tau[2] == pytest.approx(wanted, rel=1e-6, abs=1e-9)


def test_a_friction_that_is_none_is_refused_with_its_line(tmp_path: Path) -> None:
    scene = among(tmp_path, Sphere((0, 0, 10), 1.0, friction=0.5))
    file = tmp_path / "scene.yaml"
    file.write_text(file.read_text().replace("friction: 0.5", "friction: -0.5"))
    with pytest.raises(InputInvalid, match=r"scene.yaml:\d+.*friction.*from 0 to 2"):
        made(scene=scene, step=H)


# ---- derivatives, options, the page -------------------------------------------------------------


def test_directional_derivatives_are_finite_and_those_of_differences(bumpy: str) -> None:
    native, rng = made(scene=bumpy, step=H), np.random.default_rng(6)
    v = native.description.variables
    for _ in range(60):
        eta = np.array([*rng.uniform(-5, 5, 2), rng.uniform(9, 12), *rng.uniform(-1, 1, 3)])
        nu, by = rng.normal(size=6), rng.normal(size=6)
        felt(native, eta=eta, nu=nu)
        found = np.asarray(native.directional_derivative([v["tau"]], [v["nu"]], by.tolist()))
        assert np.all(np.isfinite(found))
        e = 1e-5
        ahead, behind = (felt(native, eta=eta, nu=nu + s * by)["tau"] for s in (e, -e))
        wanted = (ahead - behind) / (2 * e)
        if np.abs(wanted - found).max() > 1e-3 * (1.0 + np.abs(wanted).max()):
            # a kink within e: then only the size is compared
            assert np.abs(found).max() < 1e6


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"step": 0}, "step = 0"),
        ({"step": 0.2}, "at most 0.1 s: at longer steps .* Use step=0.1 or less"),
        ({"scene": "nowhere"}, "there is no scene 'nowhere'"),
        ({"others": 99}, "others = 99; expected 0 to 64"),
    ],
)
def test_wrong_options_are_said(options: Any, words: str) -> None:
    with pytest.raises((ParameterInvalid, InputInvalid), match=words):
        declare("contact", **options)


def test_the_survey_of_the_page_that_dives_onto_the_charted_bed_is_held_by_it() -> None:
    """The page's own lines: they give a system whose vehicle, told to go deeper, stays."""
    from uuvsim_cosim.content import content
    from uuvsim_cosim.kernels.kernel import fuse
    from uuvsim_cosim.scene.shared.ray_casting import Caster

    page = (content("docs") / "scenes" / "contact.md").read_text(encoding="utf-8")
    (code,) = [c for c in page.split("```python\n") if "def with_contact" in c]
    names: dict[str, Any] = {}
    exec(code.partition("```")[0], names)
    with fuse(names["system"]).batch(1) as batch:
        batch.step(2500)
        eta, depth = batch.get("hull.eta")[0], float(batch.get("contact.depth")[0])
    bed = float(Caster("tacoma").height(eta[0], eta[1]))
    assert 0.001 < depth < 0.04
    assert bed - 0.2 < eta[2] < bed


def test_the_force_acts_in_the_middle_of_a_later_step() -> None:
    """A hull that spins is pushed in the axes that it will have then."""
    native = made(vehicle="sphere", step=H)
    out = felt(native, eta=[0, 0, 24.85, 0, 0, 0], nu=[0, 0, 0, 1.0, 0, 0], mu=0.0)
    angle = np.arctan2(-out["tau"][1], -out["tau"][2])
    assert angle == pytest.approx(LATE * H, rel=0.01)
