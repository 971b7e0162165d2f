"""Contact of a hull in NumPy: the slow reference, which CasADi's own evaluation calls.

The law, and the words for it, are those of fmus/runtime/worlds/uuv_contact.h, with which this
agrees to rounding. Solids, hull and ridges of the seabed are zones: a centre, half axes, a ball
and a disc.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.models.worlds.ground import Ground
from uuvsim_cosim.models.worlds.ray_reference import bed_depth

__all__ = [
    "APART",
    "FORGET",
    "GRIP",
    "HEAD",
    "HOLD",
    "LATE",
    "LEAD",
    "OUT",
    "PLACE",
    "SOFT",
    "TURNED",
    "Hull",
    "free_place",
    "pressed",
]

Array = NDArray[np.float64]
HEAD = 31  # numbers before the moving: UUV_CONTACT_HEAD
PLACE = 17  # UUV_PLACE_HEAD
LEAD = 10.0  # UUV_LEAD
LATE = 2.5  # UUV_LATE
OUT = 1.0  # UUV_OUT
SOFT = 0.05  # UUV_SOFT
GRIP = 0.14  # UUV_GRIP
APART = 1e-3  # UUV_APART
HOLD, FORGET = 40.0, 100.0  # UUV_HOLD, UUV_FORGET
TURNED = 1.0  # UUV_TURNED
SWEEPS, SLIDES = 16, 6  # UUV_SWEEPS, UUV_SLIDES
CONTACTS = 32  # UUV_CONTACTS
NEAREST, PUSH = 16, 16  # UUV_SWEEPS_NEAREST, UUV_STEPS_PUSH


@dataclass(frozen=True)
class Hull:
    """The shape that stands for a hull: n half axes along x, y, z of b, and a radius around [m]."""

    middle: tuple[float, float, float]  # from CO in b
    half: tuple[float, float, float]
    n: int  # 3: a box, 1: a capsule along x, 0: a ball
    radius: float


@dataclass(frozen=True)
class Zone:
    """All sums of a centre, points of half axes (n, 3), of a ball, and of an upright disc."""

    c: Array
    g: Array
    ball: float = 0.0
    disc: float = 0.0


@dataclass
class State:
    """A hull at an instant, and the points at which it is pressed."""

    zone: Zone
    co: Array
    R: Array
    nu: Array
    late: float  # s, until the force acts
    horizon: float  # s, ahead of that
    cap: float  # m
    arm: float
    deepest: float = 0.0
    touched: int = -1
    points: list[tuple[float, Array, Array, Array, float]] = field(default_factory=list)

    def add(
        self, x: Array, m: Array, d: float, v: Array, mu: float, number: int, still: bool
    ) -> None:
        """Add the point x of the hull, d deep, pushed along m; see uuv_add_point_."""
        r, n, other = self.R.T @ (x - self.co), self.R.T @ m, self.R.T @ v
        turn = np.cross(self.nu[3:], r)
        along, turned = float(-n @ (self.nu[:3] - other)), float(-n @ turn)
        now = d - self.late * (along + turned)
        if now > self.deepest:
            self.deepest, self.touched = float(now), number
        if still:
            along = min(along, 0.0)
        e = float(min(d, self.cap) + self.horizon * (along + turned))
        if not e > 0.0:
            return
        point = (e, r, n, self.nu[:3] + turn - other, mu)
        if len(self.points) < CONTACTS:
            self.points.append(point)
            return
        least = min(range(CONTACTS), key=lambda i: self.points[i][0])
        if e > self.points[least][0]:
            self.points[least] = point


@dataclass(frozen=True)
class Pair:
    """The difference of two zones: a solid's and the hull's."""

    c: Array
    g: Array
    n_hull: int
    ball: float
    disc: float
    axes: list[Array]

    def depth(self, c: Array, u: Array) -> float:
        """Return D(u) of centres that lie c apart."""
        return float(
            self.ball - c @ u + np.abs(self.g @ u).sum() + self.disc * np.hypot(u[0], u[1])
        )

    def nearest(self, c: Array, t: Array, flat: bool = False) -> Array:
        """Return c less the nearest point of the core; t (n,) is changed to where that point is."""
        level = np.array([1.0, 1.0, 0.0 if flat else 1.0])
        g = self.g * level
        r, w = (c - t @ self.g) * level, np.zeros(2)
        for sweep in range(NEAREST):
            moved = 0.0
            for i, a in enumerate(g):
                if a @ a > 1e-18:
                    to = min(max(t[i] + (a @ r) / (a @ a), -1.0), 1.0)
                    by = to - t[i]
                    moved += abs(by)
                    t[i] = to
                    r = r - by * a
            if self.disc > 0.0 and not flat:
                at = r[:2] + w
                off = np.hypot(*at)
                w = at * (self.disc / off if off > self.disc else 1.0)
                r[:2] = at - w
            if moved < 1e-13 and sweep:
                break
        return np.asarray(r)

    def least(self, c: Array) -> tuple[float, Array]:
        """Return the least D(u) and its u."""
        tried = [self.nearest(c, np.zeros(len(self.g))), *self.axes]
        if self.disc > 0.0:
            tried.append(self.nearest(c, np.zeros(len(self.g)), flat=True))
        best, u = np.inf, np.array([0.0, 0.0, 1.0])
        for a in tried:
            size = np.linalg.norm(a)
            if size > 1e-9:
                v = a * ((-1.0 if a @ c < 0.0 else 1.0) / size)
                d = self.depth(c, v)
                if d < best:
                    best, u = d, v
        return (best if best < np.inf else self.depth(c, u)), u


def pair_of(a: Zone, b: Zone) -> Pair:
    """Return the difference of two zones."""
    g = np.vstack([a.g, b.g])
    axes = []
    for x, y in combinations(g, 2):
        n = np.cross(x, y)
        if n @ n > 1e-12 * (x @ x) * (y @ y):
            axes.append(n)
    if b.disc > 0.0:
        down = np.array([0.0, 0.0, 1.0])
        axes += [down, *(np.cross(down, x) for x in a.g)]
    axes = [n / np.linalg.norm(n) for n in axes if np.linalg.norm(n) > 1e-12]
    return Pair(b.c - a.c, g, len(a.g), a.ball + b.ball, b.disc, axes)


@dataclass(frozen=True)
class Patch:
    """The part of a surface that faces along w: p + s sides[0] + t sides[1], |s|, |t| <= 1."""

    p: Array
    sides: Array


def _face(z: Zone, w: Array, face: int) -> Patch:
    side = -1.0 if z.g[face] @ w < 0.0 else 1.0
    return Patch(z.c + side * z.g[face], z.g[[(face + 1) % 3, (face + 2) % 3]])


def _under(z: Zone, x: Array, u: Array, d: float) -> float:
    """Return the depth of a ridge d behind the point x of a box's surface; see uuv_under_."""
    size, along, at = np.sum(z.g**2, axis=1), z.g @ u, z.g @ (x - z.c)
    chord = np.inf
    for i in range(3):
        rest = size[i] + at[i] if along[i] > 0.0 else size[i] - at[i]
        if rest < chord * abs(along[i]):
            chord = rest / abs(along[i])
    if d <= 0.5 * chord:
        return d
    return float(2.0 * d * (chord - d) / chord if d < chord else -chord)


def patch_of(z: Zone, w: Array) -> Patch:
    """Return the face, line or point of a zone that faces along w."""
    p = z.c + z.ball * w
    if len(z.g) == 3:
        return _face(z, w, int(np.argmax((z.g @ w) ** 2 / np.sum(z.g**2, axis=1))))
    if z.disc > 0.0 and w[2] * w[2] > 0.5:
        p = p + np.array([0.0, 0.0, np.copysign(z.g[0, 2], w[2])])
        return Patch(p, np.sqrt(0.5) * z.disc * np.eye(3)[:2])
    if z.disc > 0.0:
        p = p + z.disc * np.array([*w[:2], 0.0]) / np.hypot(w[0], w[1])
    return Patch(p, z.g)


def _cut(v: list[tuple[Array, Array]], axis: int, side: float) -> list[tuple[Array, Array]]:
    kept = []
    for i, now in enumerate(v):
        before = v[i - 1]
        a, b = 1.0 - side * before[1][axis], 1.0 - side * now[1][axis]
        if (a < 0.0) != (b < 0.0):
            share = a / (a - b)
            kept.append(
                (before[0] + share * (now[0] - before[0]), before[1] + share * (now[1] - before[1]))
            )
        if b >= 0.0:
            kept.append(now)
    return kept


def common(hull: Patch, solid: Patch, u: Array) -> Iterator[tuple[Array, float]]:
    """Yield points of the hull's patch above the solid's, seen along u, and their depths."""
    swapped = len(hull.sides) == 2 and len(solid.sides) == 1
    cut, by = (solid, hull) if swapped else (hull, solid)
    if not len(cut.sides) or not len(by.sides):
        return
    e1 = np.cross(u, np.eye(3)[np.argmin(np.abs(u))])
    seen = np.array([e1, np.cross(u, e1)])
    a = seen @ by.sides[0]
    if len(by.sides) == 2:
        b = seen @ by.sides[1]
    else:
        c = seen @ cut.sides[0]
        across = a[0] * c[1] - a[1] * c[0]
        if len(cut.sides) != 1 or across**2 > 0.04 * (a @ a) * (c @ c):
            return
        b = np.array([-a[1], a[0]])
    whole = a[0] * b[1] - a[1] * b[0]
    if not whole**2 > 1e-8 * (a @ a) * (b @ b):
        return
    signs = [(-1, -1), (1, -1), (1, 1), (-1, 1)] if len(cut.sides) == 2 else [(-1,), (1,)]
    v = []
    for sign in signs:
        x = cut.p + np.array(sign) @ cut.sides
        f = seen @ (x - by.p)
        st = np.array([f[0] * b[1] - f[1] * b[0], a[0] * f[1] - a[1] * f[0]]) / whole
        v.append((x, st))
    for axis in range(len(by.sides)):
        v = _cut(_cut(v, axis, 1.0), axis, -1.0)
    for x, st in v:
        other = by.p + st[: len(by.sides)] @ by.sides
        d = float((x - other) @ u)
        yield (other, -d) if swapped else (x, d)


def _deepest(s: State, q: Pair, u: Array) -> tuple[Array, float]:
    d = q.depth(q.c, u)
    along = q.g @ u
    free = along**2 <= 1e-12 * np.sum(q.g**2, axis=1)
    t = np.where(free, 0.0, np.where(along < 0.0, -1.0, 1.0))
    q.nearest(q.c + (d + 0.1) * u, t)
    return s.zone.c + s.zone.ball * u + t[: q.n_hull] @ q.g[: q.n_hull], d


def _meets(s: State, q: Pair, v: Array) -> tuple[Array, bool] | None:
    """Return where a pair meets, and whether only by turning; see uuv_meets_."""
    d, u = q.least(q.c)
    if d >= 0.0:
        return u, False
    first, own, t = d, u, 0.0
    for _ in range(8):
        closing = -float(v @ u)
        t = t - d / closing if closing > 0.0 else np.inf
        if t > s.horizon:
            break
        d, after = q.least(q.c + t * v)
        if d >= -APART:
            return u, False
        u = after
    if not t > s.horizon:
        return u, False
    turning = first + s.horizon * float(np.linalg.norm(s.nu[3:])) * s.arm
    return (own, True) if turning > 0.0 else None


def _swept(q: Pair, c0: Array, c1: Array) -> tuple[float, Array, float]:
    """Return the share of the way at which a pair overlaps, direction, and last share apart."""
    share, apart, way = 0.0, 0.0, c1 - c0
    d, u = q.least(c0)
    for _ in range(SWEEPS):
        if not d < APART - 1e-9:
            break
        closing = -float(way @ u)
        if not d + (1.0 - share) * closing > APART:
            return 2.0, u, apart
        apart = share - d / closing
        share += (APART - d) / closing
        d, u = q.least(c0 + share * way)
    return (share if q.depth(c1, u) > APART else 2.0), u, max(apart, 0.0)


def _met(q: Pair, c0: Array) -> Array | None:
    """Return the direction from which a pair has met since a remembered place; see uuv_met_."""
    _, least = q.least(q.c)
    if q.depth(c0, least) <= APART:
        return None
    share, u, _ = _swept(q, c0, q.c)
    return None if share > 1.0 or u @ least > 0.5 else u


def zone_of(row: Array) -> tuple[Zone, float]:
    """Return a solid (a row of Ground.solids) as a zone, and the radius of the ball around it."""
    kind, c, size = int(row[0]), row[1:4], row[4:9]
    if kind == 0:
        axes = np.array([[size[3], size[4], 0], [-size[4], size[3], 0], [0, 0, 1.0]])
        return Zone(c, size[:3, None] * axes), float(row[9])
    if kind == 1:
        return Zone(c, np.zeros((0, 3)), size[0]), float(row[9])
    if kind == 2:
        long = size[:3] @ size[:3] > 0.0
        return Zone(c, size[:3].reshape(1, 3)[: int(long)], size[3]), float(row[9])
    return Zone(c, np.array([[0.0, 0.0, size[1]]]), 0.0, size[0]), float(row[9])


def _press_solid(
    s: State,
    z: Zone,
    bound: float,
    v_solid: Array,
    before: Array,
    mu: float,
    number: int,
    hull: Hull,
) -> None:
    v, c0 = v_solid - s.R @ s.nu[:3], z.c - s.late * v_solid - before
    spin = float(np.linalg.norm(s.nu[3:])) * s.arm
    own = float(np.linalg.norm(hull.half[: hull.n])) + hull.radius
    reach = bound + own + s.horizon * (float(np.linalg.norm(v)) + spin)
    reach += float(np.linalg.norm(z.c - s.zone.c - c0))
    if np.sum((z.c - s.zone.c) ** 2) > reach * reach:
        return
    q = pair_of(s.zone, z)
    u, still = _met(q, c0), False
    if u is None:
        meets = _meets(s, q, v - s.R @ np.cross(s.nu[3:], hull.middle))
        if meets is None:
            return
        u, still = meets
    x, d = _deepest(s, q, u)
    s.add(x, -u, d, v_solid, mu, number, still)
    for x, d in common(patch_of(s.zone, u), patch_of(z, -u), u):
        s.add(x, -u, d, v_solid, mu, number, still)


def _press_ridge(s: State, a: Array, b: Array, left: Array, right: Array, mu: float) -> None:
    nl, nr = np.cross(b - a, left - a), np.cross(right - a, b - a)
    if np.isnan([*nl, *nr]).any():
        return
    if nl[2] > 0.0:
        nl, nr = -nl, -nr
    nl, nr = nl / np.linalg.norm(nl), nr / np.linalg.norm(nr)
    if not nl @ (right - a) < -1e-6 * np.linalg.norm(right - a):
        return
    u = -(nl + nr) / np.linalg.norm(nl + nr)
    z, still_water = Zone((a + b) / 2, ((b - a) / 2).reshape(1, 3)), np.zeros(3)
    if len(s.zone.g) == 3:
        for face in range(3):
            for x, d in common(_face(s.zone, u, face), Patch(z.c, z.g), u):
                s.add(x, -u, _under(s.zone, x, u, d), still_water, mu, 0, False)
        return
    q = pair_of(s.zone, z)
    _, to = q.least(q.c)
    if to @ u > 0.5:
        x, d = _deepest(s, q, to)
        s.add(x, -to, d, still_water, mu, 0, False)


def _press_terrain(
    s: State, g: Ground, bound: float, mu: float, share: Callable[[float, float], float]
) -> None:
    if not g.z.size:
        return
    speed = np.linalg.norm(s.nu[:3]) + np.linalg.norm(s.nu[3:]) * s.arm
    ahead = s.horizon * float(speed)
    low = s.zone.c[2] + bound + ahead
    shape = np.array(g.z.shape)
    at, r = (s.zone.c[:2] - g.origin) / g.spacing, (bound + ahead) / g.spacing
    if g.low > low or np.any(at + r < 0.0) or np.any(at - r > shape - 1):
        return
    first = np.clip(np.maximum(at - r, 0.0).astype(int), 0, shape - 2)
    last = np.clip(np.maximum(at + r, 0.0).astype(int), 0, shape - 2)
    if not np.any(g.z[first[0] : last[0] + 2, first[1] : last[1] + 2] < low):
        return
    n = len(s.zone.g)
    for corner in range(1 << n):
        sign = np.array([1.0 if corner >> i & 1 else -1.0 for i in range(n)])
        p = s.zone.c + sign @ s.zone.g
        found = bed_depth(g, p, s.zone.ball + ahead)
        if found is not None:
            d, m = found
            x = p - s.zone.ball * m
            s.add(x, m, d + s.zone.ball, np.zeros(3), mu * share(p[0], p[1]), 0, False)

    def node(i: int, j: int) -> Array:
        place = (g.origin[0] + i * g.spacing, g.origin[1] + j * g.spacing)
        return np.array([*place, float(g.z[i, j])])

    for i in range(first[0], last[0] + 1):
        for j in range(first[1], last[1] + 1):
            a, b, c, d4 = node(i, j), node(i + 1, j), node(i + 1, j + 1), node(i, j + 1)
            if min(a[2], b[2], c[2], d4[2]) > low:
                continue
            edges = [(a, c, b, d4)]
            if j > 0:
                edges.append((a, b, c, node(i, j - 1)))
            if i > 0:
                edges.append((a, d4, c, node(i - 1, j)))
            for start, end, left, right in edges:
                middle = (start + end) / 2
                _press_ridge(s, start, end, left, right, mu * share(middle[0], middle[1]))


def _solve(J: Array, e: Array, most: Array, soft: Array, M: Array) -> tuple[Array, Array]:
    """Return pushes from 0 to `most` and delta = M^-1 J' push, the least with J delta >= e."""

    def cost(delta: Array) -> tuple[float, Array, Array]:
        lacks = e - J @ delta
        p = lacks / soft
        push = np.clip(p, 0.0, most)
        total = 0.5 * M @ delta**2 + push @ (lacks - 0.5 * soft * push)
        return float(total), push, np.where(p > 0.0, np.where(p < most, 1, 2), 0)

    delta = np.zeros(6)
    least, push, state = cost(delta)
    for _ in range(PUSH):
        active = J[state == 1]
        H = np.diag(M) + active.T @ (active / soft[state == 1, None])
        by = np.linalg.solve(H, J.T @ push - M * delta)
        for halved in range(6):
            found, next_push, next_state = cost(delta + 0.5**halved * by)
            if found < least:
                break
        else:
            break
        delta = delta + 0.5**halved * by
        same, least, push, state = np.array_equal(state, next_state), found, next_push, next_state
        if same and not halved:
            break
    return push, delta


def _push(s: State, x: Array) -> Array:
    M, h, kappa = x[18:24], x[24], x[25]
    e, r, n, v, mu = (np.array(a) for a in zip(*s.points, strict=True))
    soft, free = SOFT * n**2 @ (1.0 / M[:3]), np.full(len(e), np.inf)
    push, delta = _solve(np.hstack([n, np.cross(r, n)]), e, free, soft, M)
    tau = kappa / h**2 * M * delta
    slip = v - np.sum(n * v, axis=1)[:, None] * n
    speed = np.linalg.norm(slip, axis=1)
    back = np.where(speed[:, None] > 1e-12, -slip / np.maximum(speed, 1e-12)[:, None], 0.0)
    most, soft = mu * kappa / (h * GRIP) * push, np.full(len(e), SOFT * np.sum(1.0 / M[:3]))
    _, delta = _solve(np.hstack([back, np.cross(r, back)]), speed, most, soft, M)
    turn = float(np.linalg.norm(x[15:18])) * h / TURNED
    return np.asarray((tau + GRIP / h * M * delta) * min(1.0, max(0.0, 2.0 - turn)))


def _hull_at(hull: Hull, co: Array, R: Array) -> tuple[Zone, float]:
    half = np.array(hull.half[: hull.n])
    zone = Zone(co + R @ hull.middle, (R[:, : hull.n] * half).T, hull.radius)
    return zone, float(np.linalg.norm(half)) + hull.radius


def _remembers(now: Array, memory: Array, h: float, bound: float) -> bool:
    far = float(np.linalg.norm(now - memory[:3]))
    return bool(memory[3] > 0.5 and far <= FORGET * h + 2.0 * bound)


def pressed(
    g: Ground, hull: Hull, share: Callable[[float, float], float], rub: Array, x: Array
) -> Array:
    """Return the generalised force (6) on a hull, the greatest depth, and what is touched there.

    `share` gives the friction of the seabed at a place (N, E), and `rub` (solids,) that of each
    solid, beside that of mu.
    """
    R, mu, h = x[3:12].reshape(3, 3), x[26], x[24]
    present, _ = _hull_at(hull, x[:3], R)
    late, v, (a, b, c) = LATE * h, R @ x[12:15], 0.5 * LATE * h * x[15:18]
    S = np.array([[0.0, -c, b], [c, 0.0, -a], [-b, a, 0.0]])
    co = x[:3] + late * v
    R = R @ (np.eye(3) + 2.0 / (1.0 - 0.5 * np.trace(S @ S)) * (S + S @ S))
    zone, bound = _hull_at(hull, co, R)
    arm = bound + float(np.linalg.norm(hull.middle))
    nu = np.concatenate([R.T @ v, x[15:18]])
    cap = OUT * (LEAD - LATE) * h
    s = State(zone, co, R, nu, late, (LEAD - LATE) * h, cap, arm)
    _press_terrain(s, g, bound, mu, share)
    known = _remembers(present.c, x[27:31], h, bound)
    before = x[27:30] if known else present.c
    s.cap = HOLD * h if known else cap
    for i, row in enumerate(g.solids):
        _press_solid(s, *zone_of(row), np.zeros(3), before, mu * rub[i], i + 1, hull)
    s.cap = cap
    for i, m in enumerate(x[HEAD:].reshape(-1, 10)):
        if m[6] > 0.0:
            size = float(np.linalg.norm(m[3:6])) + m[6]
            row = np.array([2.0, *(m[:3] + late * m[7:]), *m[3:7], 0.0, size])
            number = len(g.solids) + i + 1
            _press_solid(s, *zone_of(row), m[7:], present.c, mu, number, hull)
    tau = _push(s, x) if s.points else np.zeros(6)
    return np.array([*tau, s.deepest, s.touched])


def free_place(g: Ground, hull: Hull, x: Array) -> Array:
    """Return the free place (3) of a hull's middle, and 1 if it counts; see uuv_place."""
    zone, bound = _hull_at(hull, x[:3], x[3:12].reshape(3, 3))
    h, memory, now = x[12], x[13:17], zone.c
    known = _remembers(now, memory, h, bound)
    at, cap, counts = (memory[:3] if known else now), OUT * (LEAD - LATE) * h, 1.0
    if not known and g.z.size:
        n = len(zone.g)
        for corner in range(1 << n):
            sign = np.array([1.0 if corner >> i & 1 else -1.0 for i in range(n)])
            found = bed_depth(g, now + sign @ zone.g, zone.ball)
            if found is not None and found[0] + zone.ball > cap:
                counts = 0.0
    solids = [zone_of(row) for row in g.solids]

    def near(reach: float) -> Iterator[Pair]:
        for z, own in solids:  # of the place where the loop stands
            if np.linalg.norm(z.c - at) <= own + bound + reach:
                yield pair_of(Zone(at, zone.g, zone.ball), z)

    most = bound + 2.0 * float(np.linalg.norm(now - at))
    for _ in range(4):
        out = True
        for q in near(0.0):
            if np.linalg.norm(now - at) > most:
                continue
            d, u = q.least(q.c)
            if d > 0.0:
                counts = 0.0 if not known and d > cap else counts
                at, out = at - d * u, False
        if out:
            break
    counts = counts if np.linalg.norm(now - at) <= most else 0.0
    normals: list[Array] = []
    for _ in range(SLIDES):
        to = now - at
        for _ in range(8):
            for m in normals:
                to = to - max(0.0, float(to @ m)) * m
        length = float(np.linalg.norm(to))
        if length < 1e-9 or counts < 0.5:
            break
        met = [_swept(q, q.c, q.c - to) for q in near(length)]
        first = min(met, key=lambda m: m[0], default=(2.0, to, 0.0))
        at = at + (1.0 if first[0] > 1.0 else first[2]) * to
        if first[0] > 1.0:
            break
        normals.append(first[1])
    return np.array([*(at if counts > 0.5 else now), counts])
