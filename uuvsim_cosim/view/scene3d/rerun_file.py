"""Export of a scene and its motion to Rerun (.rrd); needs the extra `rerun`."""

from __future__ import annotations

import re
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from uuvsim_cosim.cache import whole_file
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.notebook_bar import Progress
from uuvsim_cosim.orchestrator.recording.export import refuse_if_disk_is_small
from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals
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
from uuvsim_cosim.view.scene3d.scene import Scene3D
from uuvsim_cosim.view.scene3d.scene_of_run import placed
from uuvsim_cosim.view.scene3d.shapes import terrain_mesh

if TYPE_CHECKING:
    from rerun import RecordingStream

__all__ = ["export_rrd"]

SENT = 65_536  # rows of a signal that are sent at once
MOMENTS_MOST = 50_000  # of the moving parts; signals have every row
ARROWS_MOST = 2000  # moments of the thrusts, which are drawn one by one


def export_rrd(run: str | Path, out: Path, progress: Progress | None = None) -> Path:
    """Write a run as .rrd: the scene, and every numeric signal below /signals."""
    try:
        import rerun
    except ImportError:
        raise InputInvalid(
            out,
            "writing .rrd needs rerun-sdk, which is not installed",
            "the extra `rerun`: pip install 'uuvsim-cosim[rerun]'",
        ) from None
    scene3d, motion, traces = placed(run, lambda traces: MOMENTS_MOST)
    if not out.absolute().parent.is_dir():
        raise InputInvalid(out, "its folder does not exist", "a file in a folder")
    refuse_if_disk_is_small(read_signals(run), out)
    recording = rerun.RecordingStream("uuvsim", recording_id=scene3d.name or "run")
    with whole_file(out) as fresh:
        recording.save(str(fresh))
        try:
            _still(recording, rerun, scene3d, motion)
            _moving(recording, rerun, scene3d, motion)
            for number, (name, values) in enumerate(traces.values.items()):
                if progress is not None:
                    progress("writing", number, len(traces.values))
                table = values.reshape(len(values), -1)
                if table.shape[1] > 64:
                    continue
                place = "signals/" + "/".join(_name(part) for part in name.split("."))
                for k in range(0, len(table), SENT):
                    some = table[k : k + SENT]
                    when = [rerun.TimeColumn("time", duration=traces.time[k : k + SENT])]
                    columns = rerun.Scalars.columns(scalars=some.reshape(-1).astype(float))
                    parts = columns.partition([some.shape[1]] * len(some))
                    recording.send_columns(place, when, parts)
                recording.flush()
        finally:
            recording.disconnect()
    return out


def _still(to: RecordingStream, rr: ModuleType, scene3d: Scene3D, motion: Motion) -> None:
    to.log("world", rr.ViewCoordinates.FRD, static=True)  # N, E, D lie as ahead, right, down
    if scene3d.terrain is not None:
        mesh = terrain_mesh(scene3d.terrain, 320)
        to.log("world/terrain", rr.Mesh3D(
            vertex_positions=mesh.vertices, triangle_indices=mesh.faces,
            vertex_colors=depth_colours(mesh.vertices[:, 2]),
        ), static=True)  # fmt: skip
    for solid in scene3d.solids:
        filled = [*rgb(SOLIDS.get(solid.kind, PATH)), 90 if solid.kind == "basin" else 255]
        shape = rr.Mesh3D(
            vertex_positions=solid.mesh.vertices, triangle_indices=solid.mesh.faces,
            albedo_factor=filled,
        )  # fmt: skip
        to.log(f"world/solids/{_name(solid.name)}", shape, static=True)
    for line in scene3d.lines:
        strip = rr.LineStrips3D([line.points], colors=[rgb(PATH)])
        to.log(f"world/{_name(line.name)}", strip, static=True)
    for i, body in enumerate(scene3d.bodies):
        place = f"world/{_name(body.name)}"
        colour = rgb(BODIES[i % len(BODIES)])
        to.log(f"{place}/hull", rr.Mesh3D(
            vertex_positions=body.hull.vertices, triangle_indices=body.hull.faces,
            albedo_factor=[*colour, 255],
        ), static=True)  # fmt: skip
        for what, tracks, tint in (
            ("track", motion.positions, colour), ("estimate", motion.estimates, rgb(ESTIMATE))
        ):  # fmt: skip
            if body.name in tracks:
                track = tracks[body.name]
                strip = rr.LineStrips3D([track[np.isfinite(track).all(axis=1)]], colors=[tint])
                to.log(f"world/tracks/{_name(body.name)}_{what}", strip, static=True)
        points = echoes(body, motion)
        if len(points):
            cloud = rr.Points3D(points, colors=depth_colours(points[:, 2]), radii=0.03)
            to.log(f"world/echoes/{_name(body.name)}", cloud, static=True)
    for marker in scene3d.markers:
        ball = rr.Points3D([[0.0, 0.0, 0.0]], colors=[rgb(MARKER)], radii=marker.radius)
        to.log(f"world/{_name(marker.name)}", ball, static=True)


def _moving(to: RecordingStream, rr: ModuleType, scene3d: Scene3D, motion: Motion) -> None:
    for name, positions in motion.positions.items():
        for k in range(0, len(positions), SENT):
            rows = slice(k, k + SENT)
            when = [rr.TimeColumn("time", duration=motion.time[rows])]
            columns = {"translation": positions[rows]}
            if name in motion.attitudes:
                columns["quaternion"] = motion.attitudes[name][rows][:, [1, 2, 3, 0]]
            to.send_columns(f"world/{_name(name)}", when, rr.Transform3D.columns(**columns))
        to.flush()
    for body in scene3d.bodies:
        thrust = motion.thrusts.get(body.name)
        if thrust is None:
            continue
        picks = np.unique(np.linspace(0, len(thrust) - 1, ARROWS_MOST).astype(int))
        r, e = np.array([a.r for a in body.arrows]), np.array([a.e for a in body.arrows])
        lengths = thrust[picks] * motion.scales[body.name]
        vectors = (lengths[:, :, None] * e).reshape(-1, 3)
        n = len(body.arrows)
        columns = rr.Arrows3D.columns(
            origins=np.tile(r, (len(picks), 1)), vectors=vectors,
        ).partition([n] * len(picks))  # fmt: skip
        place = f"world/{_name(body.name)}/thrust"
        to.log(place, rr.Arrows3D.from_fields(colors=[rgb(ARROW)]), static=True)
        to.send_columns(place, [rr.TimeColumn("time", duration=motion.time[picks])], columns)


def _name(text: str) -> str:
    """Return a name without characters that would split it into parts of a path."""
    return re.sub(r"[^\w.-]+", "_", text)
