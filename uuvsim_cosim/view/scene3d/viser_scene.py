"""A scene drawn by viser: still parts once, moving parts at each moment that is shown."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.view.scene3d.colours import (
    ARROW,
    BODIES,
    ESTIMATE,
    MARKER,
    PATH,
    RAY,
    SOLIDS,
    depth_colours,
    rgb,
)
from uuvsim_cosim.view.scene3d.motion import Motion, echoes
from uuvsim_cosim.view.scene3d.scene import Body, Rays, Scene3D
from uuvsim_cosim.view.scene3d.shapes import floor, surface, terrain_mesh

if TYPE_CHECKING:
    from viser import (
        FrameHandle,
        LineSegmentsHandle,
        MeshHandle,
        PointCloudHandle,
        SceneNodeHandle,
        ViserServer,
    )

__all__ = ["ViserScene"]

Handle = TypeVar("Handle", bound="SceneNodeHandle")
Array = NDArray[np.float64]
TRACK = 2000  # points of a track, at most
LIGHT, DEEP = "#eaf3f8", "#a9c6d8"
DRAWN = 96  # rays of a sensor, at most
HEAD = 0.25  # of an arrow's length: its head


class ViserScene:
    """A scene in a server's scene; N, E, D are x, y, z, and down is down."""

    def __init__(self, server: ViserServer, scene3d: Scene3D, low: Array, high: Array) -> None:
        self.scene, self.scene3d = server.scene, scene3d
        self.parts: dict[str, list[SceneNodeHandle]] = {}  # handles by what a viewer may hide
        self._bodies: dict[str, FrameHandle] = {}
        self._markers: dict[str, MeshHandle] = {}
        self._arrows: dict[str, LineSegmentsHandle] = {}
        self._rays: dict[str, LineSegmentsHandle] = {}
        self._drawn_anew: dict[str, LineSegmentsHandle | PointCloudHandle] = {}  # tracks and echoes
        self._hidden: set[str] = set()
        self.scene.set_up_direction("-z")
        # The background is water, lighter towards the surface.
        share = np.linspace(0.0, 1.0, 64)[:, None]
        column = (1.0 - share) * np.array(rgb(LIGHT)) + share * np.array(rgb(DEEP))
        water = np.repeat(column[:, None].round().astype(np.uint8), 64, axis=1)
        self.scene.set_background_image(water)
        self._still(low, high)
        for i, body in enumerate(scene3d.bodies):
            self._add(body, rgb(BODIES[i % len(BODIES)]))
        for marker in scene3d.markers:
            self._markers[marker.name] = self.scene.add_icosphere(
                f"/markers/{marker.name}", radius=marker.radius, color=rgb(MARKER), visible=False
            )

    @property
    def coming(self) -> set[str]:
        """The parts that `tracks` will draw."""
        rays = any(b.rays for b in self.scene3d.bodies)
        return {"tracks", "echoes"} if rays else {"tracks"}

    def _keep(self, part: str, handle: Handle) -> Handle:
        self.parts.setdefault(part, []).append(handle)
        if part in self._hidden:
            handle.visible = False
        return handle

    def _anew(self, part: str, name: str) -> None:
        """Remove the part that was drawn under a name, before it is drawn again."""
        handle = self._drawn_anew.pop(name, None)
        if handle is not None:
            self.parts[part].remove(handle)
            handle.remove()

    def _still(self, low: Array, high: Array) -> None:
        scene3d, scene = self.scene3d, self.scene
        if scene3d.terrain is not None:
            import trimesh

            mesh = terrain_mesh(scene3d.terrain, 320)
            ground = trimesh.Trimesh(
                mesh.vertices, mesh.faces, process=False,
                # viser's lights make pale colours white.
                vertex_colors=(0.75 * depth_colours(mesh.vertices[:, 2])).astype(np.uint8),
            )  # fmt: skip
            self._keep("terrain", scene.add_mesh_trimesh("/terrain", ground))
        elif scene3d.bottom is not None:
            margin = 0.5 * float(max(high[:2] - low[:2])) + 5.0
            mesh = floor(low[:2] - margin, high[:2] + margin, scene3d.bottom)
            self._keep("terrain", scene.add_mesh_simple(
                "/bottom", mesh.vertices, mesh.faces, color=rgb(SOLIDS["floor"]), side="double",
            ))  # fmt: skip
        if scene3d.terrain is not None or scene3d.bottom is not None:
            margin = 0.5 * float(max(high[:2] - low[:2])) + 5.0
            mesh = surface(low[:2] - margin, high[:2] + margin)
            self._keep("surface", scene.add_mesh_simple(
                "/surface", mesh.vertices, mesh.faces[:2], color=rgb(SOLIDS["surface"]),
                opacity=0.12, side="double",
            ))  # fmt: skip
        for solid in scene3d.solids:
            opacity = 0.35 if solid.kind == "basin" else None
            self._keep("obstacles", scene.add_mesh_simple(
                f"/solids/{solid.name}", solid.mesh.vertices, solid.mesh.faces,
                color=rgb(SOLIDS.get(solid.kind, PATH)), opacity=opacity, flat_shading=True,
                side="front" if solid.kind == "basin" else "double",  # a basin is seen from within
            ))  # fmt: skip
        for line in scene3d.lines:
            if len(line.points) > 1:
                self._keep("path", scene.add_line_segments(
                    f"/path/{line.name}", _segments(line.points), rgb(PATH), line_width=2.0
                ))  # fmt: skip
            size = 0.006 * float(max(high - low))
            colours = np.tile(np.array(rgb(PATH), np.uint8), (len(line.points), 1))
            self._keep("path", scene.add_point_cloud(
                f"/path/{line.name}/points", line.points, colours, size, "circle"
            ))  # fmt: skip

    def _add(self, body: Body, colour: tuple[int, int, int]) -> None:
        frame = self.scene.add_frame(f"/{body.name}", show_axes=False, visible=False)
        self._bodies[body.name] = frame
        self.scene.add_mesh_simple(
            f"/{body.name}/hull", body.hull.vertices, body.hull.faces, color=colour,
            flat_shading=len(body.hull.faces) < 50, side="double",
            opacity=0.7 if body.arrows else None,  # thrusters often sit within
        )  # fmt: skip
        bow = body.hull.vertices.max(axis=0)
        self.scene.add_icosphere(
            f"/{body.name}/bow", radius=0.05 * body.size, color=(255, 255, 255),
            position=(float(bow[0]), 0.0, float(np.mean(body.hull.vertices[:, 2]))),
        )  # fmt: skip
        if body.arrows:
            still = np.zeros((3 * len(body.arrows), 2, 3))
            self._arrows[body.name] = self._keep("thrust", self.scene.add_line_segments(
                f"/{body.name}/thrust", still, rgb(ARROW), line_width=5.0
            ))  # fmt: skip
        for rays in body.rays:
            still = np.zeros((len(_drawn(rays)), 2, 3))
            name = f"/{body.name}/rays {rays.name}"
            handle = self.scene.add_line_segments(name, still, rgb(RAY), line_width=1.0)
            self._rays[rays.name] = self._keep("rays", handle)

    def tracks(self, motion: Motion) -> None:
        """Draw the tracks of all bodies, and the echoes."""
        for i, body in enumerate(self.scene3d.bodies):
            if body.name in motion.positions:
                self._track(body.name, motion.positions[body.name], rgb(BODIES[i % len(BODIES)]))
            if body.name in motion.estimates:
                self._track(f"{body.name} estimate", motion.estimates[body.name], rgb(ESTIMATE))
            points = echoes(body, motion)
            place = f"/echoes/{body.name}"
            self._anew("echoes", place)
            if len(points):
                size = max(0.02, 0.004 * float(np.ptp(points, axis=0).max()))
                colours = depth_colours(points[:, 2])
                cloud = self.scene.add_point_cloud(place, points, colours, size, "circle")
                self._drawn_anew[place] = self._keep("echoes", cloud)
        for marker in self.scene3d.markers:
            if marker.name in motion.positions:
                self._track(marker.name, motion.positions[marker.name], rgb(MARKER))

    def _track(self, name: str, points: Array, colour: tuple[int, int, int]) -> None:
        points = points[np.isfinite(points).all(axis=1)]
        place = f"/tracks/{name}"
        self._anew("tracks", place)
        if len(points) > 1:
            picks = np.unique(np.linspace(0, len(points) - 1, TRACK).astype(int))
            segments = _segments(points[picks])
            line = self.scene.add_line_segments(place, segments, colour, line_width=2.0)
            self._drawn_anew[place] = self._keep("tracks", line)

    def show(self, motion: Motion, k: int) -> None:
        """Place all parts as at moment k; a part without a finite position is hidden."""
        for body in self.scene3d.bodies:
            frame = self._bodies[body.name]
            at = motion.positions.get(body.name)
            there = at is not None and bool(np.isfinite(at[k]).all())
            if frame.visible != there:
                frame.visible = there
            if not there or at is None:
                continue
            frame.position, frame.wxyz = at[k], motion.attitudes[body.name][k]
            if body.name in self._arrows and body.name in motion.thrusts:
                lengths = motion.scales[body.name] * motion.thrusts[body.name][k]
                self._arrows[body.name].points = _arrows(body, lengths)
            for rays in body.rays:
                if rays.name in motion.ranges:
                    some = _drawn(rays)
                    distance = np.nan_to_num(motion.ranges[rays.name][k, some], nan=0.0)
                    ends = rays.r + rays.directions[some] * distance[:, None]
                    starts = np.broadcast_to(rays.r, ends.shape)
                    self._rays[rays.name].points = np.stack([starts, ends], axis=1)
        for name, handle in self._markers.items():
            at = motion.positions.get(name)
            there = at is not None and bool(np.isfinite(at[k]).all())
            handle.visible = there
            if there and at is not None:
                handle.position = at[k]

    def hide(self, part: str, hidden: bool) -> None:
        """Hide, or show again, a part: terrain, obstacles, path, tracks, thrust, rays, echoes."""
        (self._hidden.add if hidden else self._hidden.discard)(part)
        for handle in self.parts.get(part, []):
            handle.visible = not hidden


def _drawn(rays: Rays) -> NDArray[np.intp]:
    """Return the rays that are drawn: all, or some spread evenly."""
    n = len(rays.directions)
    return np.unique(np.linspace(0, n - 1, min(n, DRAWN)).astype(np.intp))


def _segments(points: Array) -> Array:
    return np.stack([points[:-1], points[1:]], axis=1)


def _arrows(body: Body, lengths: Array) -> Array:
    """Return shaft and head (3 n, 2, 3) of each arrow in `b`."""
    r, e = np.array([a.r for a in body.arrows]), np.array([a.e for a in body.arrows])
    tips = r + e * lengths[:, None]
    across = np.cross(e, np.where(np.abs(e[:, 2:]) > 0.9, [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]))
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    back = tips - HEAD * e * lengths[:, None]
    side = 0.5 * HEAD * across * lengths[:, None]
    shafts = np.stack([r, tips], axis=1)
    heads = [np.stack([back + s * side, tips], axis=1) for s in (-1.0, 1.0)]
    return np.concatenate([shafts, *heads])
