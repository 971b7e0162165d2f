"""The scene of a running system as channels for Foxglove, in ENU and FLU.

`/scene` has terrain, obstacles, planned paths and hulls; `/track` the way so far; `/moving` thrusts
and targets; `/echoes` the points that the rays of ranging sensors meet.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import final

import numpy as np

from uuvsim_cosim.bridge.foxglove.channels import Message, Output, json_form, nanoseconds
from uuvsim_cosim.bridge.ros2.frames import body, world
from uuvsim_cosim.bridge.ros2.rows import Block
from uuvsim_cosim.models.declaration.element_names import split_element_name
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.view.recorded.traces import Array, Traces
from uuvsim_cosim.view.scene3d.colours import ARROW, MARKER
from uuvsim_cosim.view.scene3d.foxglove_entities import (
    CLOUD,
    SCENE,
    Axes,
    ball,
    cloud,
    entity,
    point,
    schema_of,
    still_entities,
    still_pose,
    strip,
    tracks,
    triangles,
)
from uuvsim_cosim.view.scene3d.live import History
from uuvsim_cosim.view.scene3d.motion import LEAST, REACH, Motion, echoes, motion_of
from uuvsim_cosim.view.scene3d.scene import Scene3D
from uuvsim_cosim.view.scene3d.scene_of_plan import scene3d_of_plan

__all__ = ["drawing"]

_PIECE = 64  # points that are encoded at once; the interpreter cannot switch threads meanwhile
_FAST, _SLOW = 0.1, 1.0  # [s] between two clouds or thrusts, and between two tracks


def drawing(plan: Plan) -> list[Output]:
    """Return the channels that draw a system; none if it has nothing to draw."""
    scene3d = scene3d_of_plan(plan)
    frames = {b.name: _base_link(b.eta) for b in scene3d.bodies}
    axes = Axes("map", lambda name: frames.get(name, name), world, body)
    outputs: list[Output] = []
    if any((scene3d.bodies, scene3d.solids, scene3d.lines, scene3d.terrain)):
        outputs.append(_Scene(scene3d, axes))
    if scene3d.bodies:
        outputs.append(_Track(scene3d, axes))
    if scene3d.markers or any(b.arrows for b in scene3d.bodies):
        outputs.append(_Moving(scene3d, axes))
    if any(b.rays for b in scene3d.bodies):
        outputs.append(_Echoes(scene3d, axes))
    return outputs


def _base_link(eta: str) -> str:
    """Return the frame of a hull, as `bridge.ros2.topics` names it."""
    prefix = eta.rpartition(".")[0].rpartition(".")[0].replace(".", "/")
    return f"{prefix}/base_link".removeprefix("/")


class _Drawn(Output):
    """A channel of the scene, as JSON."""

    def __init__(
        self, scene3d: Scene3D, axes: Axes, topic: str, type_: str, fields: Mapping[str, str]
    ) -> None:
        self.topic, self.form = topic, json_form(schema_of(type_, fields))
        self._scene3d, self._axes, self._next = scene3d, axes, -np.inf

    def _due(self, period: float, clock: Callable[[], float] = time.monotonic) -> bool:
        now = clock()
        if now < self._next:
            return False
        self._next = now + period
        return True

    def _motion(self, block: Block) -> Motion:
        """Return the motion at the last row."""
        wholes = {split_element_name(name)[0] for name in self._scene3d.signals}
        values = {n: np.asarray(block[n], float)[-1:] for n in wholes if n in block}
        return motion_of(self._scene3d, Traces(block.time[-1:], values))


def _update(at: int, entities: list[dict[str, object]]) -> Message:
    return at, _json({"deletions": [], "entities": entities})


def _json(message: object) -> bytes:
    return json.dumps(message, separators=(",", ":"), allow_nan=False).encode()


def _in_pieces(value: object) -> str:
    """Return JSON that is encoded piece by piece, so that steps go on in between."""
    if isinstance(value, dict):
        return "{" + ",".join(f'"{k}":{_in_pieces(v)}' for k, v in value.items()) + "}"
    if isinstance(value, list) and len(value) <= _PIECE:
        return "[" + ",".join(map(_in_pieces, value)) + "]"
    if isinstance(value, list):
        pieces = (value[i : i + _PIECE] for i in range(0, len(value), _PIECE))
        return "[" + ",".join(_json(piece).decode()[1:-1] for piece in pieces) + "]"
    return _json(value).decode()


@final
class _Scene(_Drawn):
    """Parts that do not move, or move with their frame: they are sent once to each subscriber."""

    def __init__(self, scene3d: Scene3D, axes: Axes) -> None:
        super().__init__(scene3d, axes, "/scene", "foxglove.SceneUpdate", SCENE)
        self._data = b""

    def messages(self, block: Block) -> Iterator[Message]:
        yield from ()

    def whole(self, newest: Block) -> Iterator[Message]:
        [at] = nanoseconds(newest.time)
        if not self._data:
            # A marker has a position and no frame: it is drawn with what moves.
            still = replace(self._scene3d, markers=())
            entities = list(still_entities(still, 0, self._axes))
            self._data = _in_pieces({"deletions": [], "entities": entities}).encode()
        yield at, self._data


@final
class _Track(_Drawn):
    """Ways of hulls and of their estimates, at most 2000 points each."""

    def __init__(self, scene3d: Scene3D, axes: Axes) -> None:
        super().__init__(scene3d, axes, "/track", "foxglove.SceneUpdate", SCENE)
        self._names = [
            f"{b.name} {what}[{i}]"
            for b in scene3d.bodies
            for what in ("track", *(["estimate"] if b.estimate else []))
            for i in (1, 2, 3)
        ]
        self._history = History()

    def messages(self, block: Block) -> Iterator[Message]:
        self._keep(block)
        if self._due(_SLOW):
            yield from self._drawn(block)

    def whole(self, newest: Block) -> Iterator[Message]:
        self._keep(newest)
        yield from self._drawn(newest)

    def _keep(self, block: Block) -> None:
        motion = self._motion(block)
        row: list[float] = []
        for b in self._scene3d.bodies:
            for found in (motion.positions, *([motion.estimates] if b.estimate else [])):
                row += found[b.name][0].tolist() if b.name in found else [np.nan] * 3
        self._history.add(float(block.time[-1]), np.array(row))

    def _drawn(self, block: Block) -> Iterator[Message]:
        [at] = nanoseconds(block.time[-1:])
        ways = self._history.traces(self._names, {}).values
        positions, estimates = (
            {b.name: ways[f"{b.name} {what}"] for b in self._scene3d.bodies
             if f"{b.name} {what}" in ways}
            for what in ("track", "estimate")
        )  # fmt: skip
        yield _update(at, list(tracks(self._scene3d, positions, estimates, at, self._axes)))


@final
class _Moving(_Drawn):
    """Arrows of thrusters, of which the longest stands for the greatest thrust, and targets."""

    def __init__(self, scene3d: Scene3D, axes: Axes) -> None:
        super().__init__(scene3d, axes, "/moving", "foxglove.SceneUpdate", SCENE)
        self._greatest = {b.name: LEAST for b in scene3d.bodies}  # N

    def messages(self, block: Block) -> Iterator[Message]:
        if self._due(_FAST):
            yield from self.whole(block)

    def whole(self, newest: Block) -> Iterator[Message]:
        [at] = nanoseconds(newest.time[-1:])
        motion, entities = self._motion(newest), []
        for b in self._scene3d.bodies:
            thrust = motion.thrusts.get(b.name)
            if thrust is None:
                continue
            self._greatest[b.name] = max(self._greatest[b.name], float(abs(thrust).max()))
            lengths = REACH * b.size / self._greatest[b.name] * thrust[0]
            r, e = np.array([a.r for a in b.arrows]), np.array([a.e for a in b.arrows])
            ends = np.stack([r, r + lengths[:, None] * e], axis=1).reshape(-1, 3)
            line = strip(self._axes.body(ends), ARROW) | {"type": 2, "thickness": 4.0}
            frame = self._axes.frame_of(b.name)
            entities.append(entity(f"{b.name} thrust", frame, at, locked=True, lines=[line]))
        for marker in self._scene3d.markers:
            place = motion.positions.get(marker.name)
            if place is not None and np.isfinite(place).all():
                shape = triangles(ball(marker.radius), MARKER)
                shape["pose"] = {**still_pose(), "position": point(self._axes.world(place)[0])}
                entities.append(entity(marker.name, self._axes.frame, at, triangles=[shape]))
        yield _update(at, entities)


@final
class _Echoes(_Drawn):
    """Points that rays meet, in `map`: a new reading, at most ten times a second."""

    def __init__(self, scene3d: Scene3D, axes: Axes) -> None:
        super().__init__(scene3d, axes, "/echoes", "foxglove.PointCloud", CLOUD)
        self._before: dict[str, Array] = {}

    def messages(self, block: Block) -> Iterator[Message]:
        if not self._due(_FAST):
            return
        motion = self._motion(block)
        fresh = {
            name: distance
            for name, distance in motion.ranges.items()
            if not np.array_equal(distance, self._before.get(name, []), equal_nan=True)
        }
        self._before = dict(motion.ranges)
        yield from self._cloud(block, replace(motion, ranges=fresh))

    def whole(self, newest: Block) -> Iterator[Message]:
        yield from self._cloud(newest, self._motion(newest))

    def _cloud(self, block: Block, motion: Motion) -> Iterator[Message]:
        points = np.concatenate([echoes(b, motion) for b in self._scene3d.bodies])
        if len(points):
            [at] = nanoseconds(block.time[-1:])
            yield at, _json(cloud(self._axes.world(points), at, self._axes.frame))
