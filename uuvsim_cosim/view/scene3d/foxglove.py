"""Export of a scene and its motion to MCAP for Foxglove: frames, entities, points, poses.

Schemas are Foxglove's (foxglove.FrameTransforms, .SceneUpdate, .PointCloud, .PosesInFrame) as
JSON. The root frame `world` is ENU, up is up; below it is `ned`, and below that each vehicle in
FRD.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from uuvsim_cosim.cache import whole_file
from uuvsim_cosim.errors import RecordingError
from uuvsim_cosim.notebook_bar import Progress
from uuvsim_cosim.view.recorded.traces import Array, Traces
from uuvsim_cosim.view.scene3d.colours import ARROW
from uuvsim_cosim.view.scene3d.foxglove_entities import (
    CLOUD,
    NED,
    SCENE,
    cloud,
    entity,
    point,
    schema_of,
    stamp,
    still_entities,
    strip,
    tracks,
)
from uuvsim_cosim.view.scene3d.motion import Motion, echoes
from uuvsim_cosim.view.scene3d.scene import Scene3D
from uuvsim_cosim.view.scene3d.scene_of_run import placed

if TYPE_CHECKING:
    from uuvsim_cosim.orchestrator.recording.mcap_file import McapFile

__all__ = ["FoxgloveScene", "export_scene_mcap"]

RATE, MOST = 20.0, 20_000  # Hz, moments
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
        scene = _channel(writer, "/scene", "foxglove.SceneUpdate", SCENE)
        thrust = _channel(writer, "/thrust", "foxglove.SceneUpdate", SCENE)
        begin = self.nanoseconds[0]
        entities = [
            *still_entities(self.scene3d, begin, NED),
            *tracks(self.scene3d, self.motion.positions, self.motion.estimates, begin, NED),
        ]
        _say(writer, scene, begin, {"deletions": [], "entities": entities})
        points = [echoes(b, self.motion) for b in self.scene3d.bodies]
        if any(len(p) for p in points):
            channel = _channel(writer, "/echoes", "foxglove.PointCloud", CLOUD)
            _say(writer, channel, begin, cloud(np.concatenate(points), begin, "ned"))
        if self.scene3d.lines:
            channel = _channel(writer, "/path", "foxglove.PosesInFrame", {"poses": "array"})
            poses = [
                {"position": point(p), "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}
                for line in self.scene3d.lines
                for p in line.points.tolist()
            ]
            message = {"timestamp": stamp(begin), "frame_id": "ned", "poses": poses}
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
                    line = strip(ends, ARROW) | {"type": 2, "thickness": 4.0}
                    entities.append(
                        entity(f"{b.name} thrust", b.name, at, locked=True, lines=[line])
                    )
            if entities:
                _say(writer, thrust, at, {"deletions": [], "entities": entities})


def _channel(writer: McapFile, topic: str, name: str, fields: dict[str, str]) -> int:
    data = json.dumps(schema_of(name, fields)).encode()
    schema = writer.register_schema(name=name, encoding="jsonschema", data=data)
    return writer.register_channel(topic, "json", schema, {})


def _say(writer: McapFile, channel: int, at: int, message: Mapping[str, object]) -> None:
    data = json.dumps(message, separators=(",", ":"), allow_nan=False).encode()
    writer.add_message(channel, at, data)


def _transform(parent: str, child: str, p: Array, q: Array, at: int) -> dict[str, object]:
    rotation = {axis: float(v) for axis, v in zip("wxyz", q, strict=True)}
    return {
        "timestamp": stamp(at), "parent_frame_id": parent, "child_frame_id": child,
        "translation": point(p), "rotation": rotation,
    }  # fmt: skip
