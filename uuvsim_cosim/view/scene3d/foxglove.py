"""Export of a scene and its motion to MCAP for Foxglove: frames, entities, points, poses.

Schemas are Foxglove's (foxglove.FrameTransforms, .SceneUpdate, .PointCloud, .PosesInFrame) as
JSON. The root frame `world` is ENU, up is up; below it is `ned`, and below that each vehicle in
FRD.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from uuvsim_cosim.cache import whole_file
from uuvsim_cosim.errors import RecordingError
from uuvsim_cosim.notebook_bar import Progress
from uuvsim_cosim.view.recorded.traces import Array, Traces
from uuvsim_cosim.view.scene3d.colours import (
    ARROW,
    BODIES,
    ESTIMATE,
    MARKER,
    PATH,
    SOLIDS,
    depth_colours,
    rgb,
)
from uuvsim_cosim.view.scene3d.motion import Motion, echoes
from uuvsim_cosim.view.scene3d.scene import Mesh, Scene3D
from uuvsim_cosim.view.scene3d.scene_of_run import placed
from uuvsim_cosim.view.scene3d.shapes import lathe, terrain_mesh

if TYPE_CHECKING:
    from uuvsim_cosim.orchestrator.recording.mcap_file import McapFile

__all__ = ["FoxgloveScene", "export_scene_mcap"]

RATE, MOST = 20.0, 20_000  # Hz, moments
TRACK = 2000
ROOT = 0.5**0.5  # ENU from NED: half a turn about north-east


def export_scene_mcap(run: str | Path, out: Path, progress: Progress | None = None) -> Path:
    """Write a run's signals and its scene into one MCAP file, whole or not at all."""
    from uuvsim_cosim.orchestrator.recording.export import refuse_if_disk_is_small
    from uuvsim_cosim.orchestrator.recording.mcap import write_mcap
    from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals

    def moments(traces: Traces) -> int:
        return int(min(MOST, RATE * float(traces.time[-1] - traces.time[0]) + 2))

    scene3d, motion, _ = placed(run, moments)
    scene = FoxgloveScene(scene3d, motion)
    signals = read_signals(run)
    try:
        refuse_if_disk_is_small(signals, out)
        with whole_file(out) as fresh:
            write_mcap(signals, fresh, scene.write, progress)
    except OSError as error:
        raise RecordingError(
            out, f"cannot be written ({error.strerror or error})", "a folder that can be written"
        ) from error
    return out


class FoxgloveScene:
    """Writes a scene to an MCAP writer: still parts once at the start, moving parts over time."""

    def __init__(self, scene3d: Scene3D, motion: Motion) -> None:
        self.scene3d, self.motion = scene3d, motion
        self.nanoseconds = np.rint(motion.time * 1e9).astype(np.int64).tolist()

    def write(self, writer: McapFile) -> None:
        """Write the channels /tf, /scene, /thrust, /echoes and /path."""
        tf = _channel(writer, "/tf", "foxglove.FrameTransforms", {"transforms": "array"})
        scene = _channel(
            writer, "/scene", "foxglove.SceneUpdate", {"deletions": "array", "entities": "array"}
        )
        thrust = _channel(
            writer, "/thrust", "foxglove.SceneUpdate", {"deletions": "array", "entities": "array"}
        )
        begin = self.nanoseconds[0]
        _say(writer, scene, begin, {"deletions": [], "entities": self._entities(begin)})
        points = [echoes(b, self.motion) for b in self.scene3d.bodies]
        if any(len(p) for p in points):
            channel = _channel(writer, "/echoes", "foxglove.PointCloud", {"data": "string"})
            fields = [{"name": n, "offset": 4 * i, "type": 7} for i, n in enumerate("xyz")]
            data = base64.b64encode(np.concatenate(points).astype("<f4").tobytes()).decode()
            _say(writer, channel, begin, {
                "timestamp": _stamp(begin), "frame_id": "ned", "pose": _still(), "point_stride": 12,
                "fields": fields, "data": data,
            })  # fmt: skip
        if self.scene3d.lines:
            channel = _channel(writer, "/path", "foxglove.PosesInFrame", {"poses": "array"})
            poses = [
                {"position": _point(p), "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}
                for line in self.scene3d.lines
                for p in line.points.tolist()
            ]
            message = {"timestamp": _stamp(begin), "frame_id": "ned", "poses": poses}
            _say(writer, channel, begin, message)
        for k, at in enumerate(self.nanoseconds):
            transforms = [
                _transform("world", "ned", np.zeros(3), np.array([0.0, ROOT, ROOT, 0.0]), at)
            ]
            for name, positions in self.motion.positions.items():
                if np.isfinite(positions[k]).all():
                    attitude = self.motion.attitudes.get(name)
                    q = np.array([1.0, 0.0, 0.0, 0.0]) if attitude is None else attitude[k]
                    transforms.append(_transform("ned", name, positions[k], q, at))
            _say(writer, tf, at, {"transforms": transforms})
            entities = []
            for b in self.scene3d.bodies:
                if b.name in self.motion.thrusts:
                    lengths = self.motion.scales[b.name] * self.motion.thrusts[b.name][k]
                    r, e = np.array([a.r for a in b.arrows]), np.array([a.e for a in b.arrows])
                    ends = np.stack([r, r + lengths[:, None] * e], axis=1).reshape(-1, 3)
                    strip = _strip(ends, ARROW) | {"type": 2, "thickness": 4.0}
                    entities.append(_entity(f"{b.name} thrust", b.name, at, lines=[strip]))
            if entities:
                _say(writer, thrust, at, {"deletions": [], "entities": entities})

    def _entities(self, at: int) -> list[dict[str, object]]:
        scene3d, found = self.scene3d, []
        if scene3d.terrain is not None:
            mesh = terrain_mesh(scene3d.terrain, 128)
            colours = [_colour(c) for c in depth_colours(mesh.vertices[:, 2]).tolist()]
            shape = _triangles(mesh, PATH) | {"colors": colours}
            found.append(_entity("terrain", "ned", at, triangles=[shape]))
        for solid in scene3d.solids:
            alpha = 0.3 if solid.kind == "basin" else 1.0
            shape = _triangles(solid.mesh, SOLIDS.get(solid.kind, PATH), alpha)
            found.append(_entity(solid.name, "ned", at, triangles=[shape]))
        found += [
            _entity(line.name, "ned", at, lines=[_strip(line.points, PATH)])
            for line in scene3d.lines
        ]
        for i, body in enumerate(scene3d.bodies):
            colour = BODIES[i % len(BODIES)]
            hull = _triangles(body.hull, colour)
            found.append(_entity(f"{body.name} hull", body.name, at, triangles=[hull], locked=True))
            for track, tint in (
                (self.motion.positions.get(body.name), colour),
                (self.motion.estimates.get(body.name), ESTIMATE),
            ):
                if track is not None:
                    name = f"{body.name} {'track' if tint == colour else 'estimate'}"
                    found.append(_entity(name, "ned", at, lines=[_strip(track, tint)]))
        t = np.linspace(0.0, np.pi, 9)
        for marker in scene3d.markers:
            ball = lathe(-marker.radius * np.cos(t), marker.radius * np.sin(t), 14)
            shape = _triangles(ball, MARKER)
            found.append(_entity(marker.name, marker.name, at, triangles=[shape], locked=True))
        return found


def _channel(writer: McapFile, topic: str, name: str, fields: dict[str, str]) -> int:
    properties = {
        "timestamp": {"type": "object"}, "frame_id": {"type": "string"},
        **{field: {"type": kind} for field, kind in fields.items()},
    }  # fmt: skip
    if name == "foxglove.PointCloud":
        properties["data"]["contentEncoding"] = "base64"
    about = {"type": "object", "title": name, "properties": properties}
    data = json.dumps(about).encode()
    schema = writer.register_schema(name=name, encoding="jsonschema", data=data)
    return writer.register_channel(topic, "json", schema, {})


def _say(writer: McapFile, channel: int, at: int, message: Mapping[str, object]) -> None:
    data = json.dumps(message, separators=(",", ":"), allow_nan=False).encode()
    writer.add_message(channel, at, data)


def _stamp(at: int) -> dict[str, int]:
    return {"sec": at // 1_000_000_000, "nsec": at % 1_000_000_000}


def _point(p: Array | Sequence[float]) -> dict[str, float]:
    return {axis: round(float(v), 5) for axis, v in zip("xyz", p, strict=True)}


def _still() -> dict[str, object]:
    return {"position": _point((0, 0, 0)), "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}


def _colour(c: list[int] | tuple[int, ...], alpha: float = 1.0) -> dict[str, float]:
    return {"r": round(c[0] / 255, 3), "g": round(c[1] / 255, 3), "b": round(c[2] / 255, 3),
            "a": alpha}  # fmt: skip


def _transform(parent: str, child: str, p: Array, q: Array, at: int) -> dict[str, object]:
    rotation = {axis: float(v) for axis, v in zip("wxyz", q, strict=True)}
    return {
        "timestamp": _stamp(at), "parent_frame_id": parent, "child_frame_id": child,
        "translation": _point(p), "rotation": rotation,
    }  # fmt: skip


def _entity(
    name: str, frame: str, at: int, *, locked: bool = False, **shapes: list[dict[str, object]]
) -> dict[str, object]:
    kinds = ("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")
    return {
        "timestamp": _stamp(at), "frame_id": frame, "id": name, "lifetime": _stamp(0),
        "frame_locked": locked or frame != "ned", "metadata": [],
        **{kind: shapes.get(kind, []) for kind in kinds},
    }  # fmt: skip


def _triangles(mesh: Mesh, colour: str, alpha: float = 1.0) -> dict[str, object]:
    return {
        "pose": _still(), "points": [_point(v) for v in mesh.vertices.tolist()],
        "color": _colour(rgb(colour), alpha), "colors": [],
        "indices": mesh.faces.reshape(-1).tolist(),
    }  # fmt: skip


def _strip(points: Array, colour: str) -> dict[str, object]:
    known = points[np.isfinite(points).all(axis=1)]
    picks = np.unique(np.linspace(0, max(len(known) - 1, 0), min(TRACK, len(known))).astype(int))
    return {
        "type": 0, "pose": _still(), "thickness": 2.0, "scale_invariant": True,
        "points": [_point(p) for p in known[picks].tolist()], "color": _colour(rgb(colour)),
        "colors": [], "indices": [],
    }  # fmt: skip
