"""Target tracking's reward: closed forms of lambda_2, telescoping, invariances, both profiles."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from uuvsim_cosim.envs.task.episode_draws import Draws
from uuvsim_cosim.envs.tasks.tracking_reward import (
    PROFILES,
    Scene,
    Terms,
    TrackingRules,
    lambda_2,
    reward_terms,
    rules_of,
)
from uuvsim_cosim.envs.tasks.tracking_start import Arena, legal_start
from uuvsim_cosim.errors import InputInvalid

Array = NDArray[np.float64]
RULES = PROFILES["default"]
STRIDE = 0.16  # m: 0.4 m/s for 0.4 s


def scene(trackers: Array, target: Array, obstacles: Array | None = None) -> Scene:
    n = len(trackers)
    own = np.zeros((n, 0, 3)) if obstacles is None else obstacles
    return Scene(trackers, target, own, np.ones(own.shape[:2], bool))


def a_scene(n: int = 40, N: int = 3, M: int = 2, seed: int = 0) -> Scene:
    rng = np.random.default_rng(seed)
    obstacles = rng.uniform(-1.3, 1.3, (n, M, 3))
    obstacles[..., 2] = rng.uniform(0.1, 0.2, (n, M))
    return scene(rng.uniform(-1.3, 1.3, (n, N, 2)), rng.uniform(-1.3, 1.3, (n, 2)), obstacles)


def terms(now: Scene, before: Scene | None = None, rules: TrackingRules = RULES) -> Terms:
    return reward_terms(now, now if before is None else before, rules, STRIDE)


@pytest.mark.parametrize(
    ("points", "expected"),
    [
        ([[0, 0], [2.3, 0]], 2.0),  # two that are connected: the eigenvalues are 0 and 2
        ([[0, 0], [2.5, 0]], 0.0),
        ([[0, 0], [1, 0], [0, 1]], 3.0),  # complete: 0, N, N
        ([[0, 0], [2, 0], [4, 0]], 1.0),  # a path of three: 0, 1, 3
        ([[0, 0], [1, 0], [9, 0]], 0.0),
        ([[0, 0], [2, 0], [4, 0], [6, 0]], 2 - np.sqrt(2)),  # a path of four
        ([[0, 0]], 0.0),
    ],
)
def test_lambda_2_of_small_graphs_is_that_of_the_textbook(
    points: list[list[float]], expected: float
) -> None:
    assert lambda_2(np.array([points], float), RULES)[0] == pytest.approx(expected, abs=1e-12)


def test_with_exponential_edges_a_triangle_has_three_times_its_weight() -> None:
    points = np.array([[[0, 0], [1, 0], [0.5, np.sqrt(0.75)]]])
    weight = np.exp(-0.5 / RULES.d_m**2)
    smooth = replace(RULES, edges="exponential")
    assert lambda_2(points, smooth)[0] == pytest.approx(3 * weight)
    assert lambda_2(points[:, :2], smooth)[0] == pytest.approx(2 * weight)


def test_a_complete_team_earns_the_whole_of_r_c_and_a_single_one_nothing() -> None:
    for N in (2, 3, 8):
        close = scene(np.zeros((1, N, 2)), np.full((1, 2), 0.8))
        assert terms(close).r_c[0] == pytest.approx(1000.0)
    assert terms(scene(np.zeros((1, 1, 2)), np.zeros((1, 2)))).r_c[0] == 0.0


def test_coming_closer_telescopes_so_that_creeping_in_and_dashing_out_earns_nothing() -> None:
    far = np.array([1.0, 0.95, 0.9, 0.85, 0.8, 0.75, 0.9, 1.0])  # slowly in, fast out
    scenes = [scene(np.array([[[d, 0.0]]]), np.zeros((1, 2))) for d in far]
    earned = [terms(b, a).r_a[0, 0] for a, b in pairwise(scenes)]
    assert sum(earned) == pytest.approx((far[0] - far[-1]) / STRIDE, abs=1e-12)
    literal = replace(RULES, approach="literal")
    paid = [terms(b, a, literal).r_a[0, 0] for a, b in pairwise(scenes)]
    assert sum(paid) == 5.0  # the paper's form pays for it


def test_what_is_earned_does_not_depend_on_where_north_is_or_the_origin() -> None:
    now, before = a_scene(seed=1), a_scene(seed=2)
    c, s = np.cos(0.7), np.sin(0.7)
    R = np.array([[c, s], [-s, c]])

    def moved(x: Scene) -> Scene:
        obstacles = x.obstacles.copy()
        obstacles[..., :2] = obstacles[..., :2] @ R + [3.0, -5.0]
        return Scene(x.trackers @ R + [3.0, -5.0], x.target @ R + [3.0, -5.0], obstacles, x.reaches)

    a, b = terms(now, before), terms(moved(now), moved(before))
    for name in ("r_c", "r_t", "r_a", "p_1", "p_2", "p_3", "nearest"):
        np.testing.assert_allclose(getattr(a, name), getattr(b, name), atol=1e-9)


def test_permuting_trackers_permutes_what_they_earn() -> None:
    now, before, order = a_scene(N=4, seed=3), a_scene(N=4, seed=4), [2, 0, 3, 1]
    a = terms(now, before)
    b = terms(
        replace(now, trackers=now.trackers[:, order]),
        replace(before, trackers=before.trackers[:, order]),
    )
    own = replace(RULES, credit="own")
    np.testing.assert_allclose(b.rewards(own), a.rewards(own)[:, order], atol=1e-12)
    np.testing.assert_allclose(b.rewards(RULES), a.rewards(RULES), atol=1e-12)
    np.testing.assert_allclose(a.rewards(RULES).std(axis=1), 0.0, atol=1e-12)  # a team's reward


def test_one_row_of_a_thousand_is_what_one_environment_gets() -> None:
    now, before = a_scene(1000, 5, seed=5), a_scene(1000, 5, seed=6)
    whole = terms(now, before).rewards(RULES)
    for i in (0, 1, 500, 999):
        one = [
            Scene(x.trackers[[i]], x.target[[i]], x.obstacles[[i]], x.reaches[[i]])
            for x in (now, before)
        ]
        assert np.array_equal(terms(*one).rewards(RULES)[0], whole[i])


@pytest.mark.parametrize(("gap", "punished"), [(0.39, False), (0.37, True)])
def test_each_penalty_begins_at_its_distance(gap: float, punished: bool) -> None:
    far = np.full((1, 2), 9.0)
    pair = terms(scene(np.array([[[0, 0], [gap, 0]]]), far))
    near_target = terms(scene(np.array([[[gap, 0.0]]]), np.zeros((1, 2))))
    wide = np.array([[[0.0, 0.0, 0.2]]])  # to the surface, not to the centre
    near_obstacle = terms(scene(np.array([[[gap + 0.2, 0.0]]]), far, wide))
    penalty = -500.0 if punished else 0.0
    assert pair.p_1.tolist() == [[penalty, penalty]]
    assert near_target.p_2.tolist() == [[penalty]]
    assert near_obstacle.p_3.tolist() == [[penalty]]
    assert near_obstacle.violated.tolist() == [[punished]]


def test_an_obstacle_that_ends_below_the_plane_does_not_count() -> None:
    low = scene(np.zeros((1, 1, 2)), np.full((1, 2), 9.0), np.array([[[0.0, 0.0, 0.2]]]))
    assert terms(replace(low, reaches=np.array([[False]]))).p_3[0, 0] == 0.0


def test_the_default_profile_weighs_as_the_document_says() -> None:
    """At 0.8 m, standing still, connected:  1e-3 · 1000 + 2;  one penalty costs 5."""
    at = scene(np.array([[[0.8, 0.0], [-0.8, 0.0]]]), np.zeros((1, 2)))
    assert terms(at).rewards(RULES)[0].tolist() == [3.0, 3.0]
    close = scene(np.array([[[0.3, 0.0], [-0.8, 0.0]]]), np.zeros((1, 2)))
    own = replace(RULES, credit="own")
    assert terms(close).rewards(own)[0].tolist() == [-2.0, 3.0]


def test_table1_is_the_paper_to_the_letter() -> None:
    literal = PROFILES["table1"]
    apart = scene(np.array([[[0.8, 0.0], [9.0, 0.0]]]), np.zeros((1, 2)))
    given = terms(apart, rules=literal)
    assert given.r_c[0] == 1000.0  # lambda_2 is 0 and not less: "connected"
    assert given.rewards(replace(literal, credit="own"))[0].tolist() == [1002.0, 1000.0]
    close = terms(scene(np.array([[[0.3, 0.0]]]), np.zeros((1, 2))), rules=literal)
    assert close.rewards(literal)[0, 0] == 1000.0 + 2.0 - 500.0


def test_a_heavy_vehicle_keeps_a_greater_distance() -> None:
    assert rules_of("default", "bluerov2_heavy").d_su == 0.75
    assert rules_of("table1", "pool8", w_p=0.5).w_p == 0.5


def test_wrong_names_are_refused_with_the_right_ones() -> None:
    with pytest.raises(InputInvalid, match="profile 'table2'; expected one of default, table1"):
        rules_of("table2", "pool8")
    with pytest.raises(InputInvalid, match="no rule 'd_tt'; expected one such as d_"):
        rules_of("default", "pool8", d_tt=1.0)


@pytest.mark.parametrize(("N", "M"), [(1, 0), (2, 2), (4, 3), (8, 0)])
def test_nobody_is_punished_at_a_legal_start_and_all_are_in_the_arena(N: int, M: int) -> None:
    arena = Arena() if N < 8 else Arena((6.0, 6.0, 1.1))
    draws = Draws(np.arange(500), np.zeros(500, int))
    radii = draws.uniform("radii", 0.1, 0.2, (M,))
    trackers, target, obstacles = legal_start(draws, arena, RULES, N, radii)
    at = scene(trackers, target, np.concatenate([obstacles, radii[..., None]], axis=2))
    assert not terms(at).violated.any()
    half = np.array(arena.size[:2]) / 2
    assert np.all(np.abs(trackers) <= half - 0.3)
    assert np.all(np.abs(target) <= half - 0.25)
    assert trackers[:, 0].std(axis=0) == pytest.approx(2 * (half - 0.3) / np.sqrt(12), rel=0.15)


def test_a_start_depends_on_its_own_seed_and_episode_alone() -> None:
    many = Draws(np.arange(300), np.full(300, 2))
    whole = legal_start(many, Arena(), RULES, 2, many.uniform("radii", 0.1, 0.2, (2,)))
    for i in (0, 17, 299):
        one = many.rows([i])
        alone = legal_start(one, Arena(), RULES, 2, one.uniform("radii", 0.1, 0.2, (2,)))
        assert all(np.array_equal(a[0], b[i]) for a, b in zip(alone, whole, strict=True))


def test_an_arena_without_room_is_refused() -> None:
    draws = Draws([0], [0])
    with pytest.raises(InputInvalid, match="no legal start in 400 tries for 8 trackers"):
        legal_start(draws, Arena((1.0, 1.2, 1.1)), RULES, 8, np.zeros((1, 0)))
