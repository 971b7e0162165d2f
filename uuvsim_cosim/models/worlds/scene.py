"""A scene folder: terrain, obstacles and meshes, as `scene.yaml` lists them."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, fields
from math import isfinite
from pathlib import Path
from typing import Any

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid, ParameterInvalid, Problem
from uuvsim_cosim.models.declaration.modeline import headed, keep_schemas
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.models.declaration.parameter_files import line_of, read_yaml
from uuvsim_cosim.models.worlds.obstacles import Box, Capsule, Cylinder, Obstacle, Sphere
from uuvsim_cosim.models.worlds.placed_mesh import (
    MOST_TRIANGLES,
    PlacedMesh,
    gltf_parts,
    placed_mesh,
)
from uuvsim_cosim.models.worlds.terrain import Terrain, load_terrain, save_terrain

__all__ = ["Scene", "find_scene", "load_scene", "save_scene", "scene_ids"]

_SHAPES: dict[str, type[Obstacle]] = {
    "box": Box,
    "sphere": Sphere,
    "capsule": Capsule,
    "cylinder": Cylinder,
}
_WORDS = ("unit", "axes", "material", "name")  # of a mesh


@dataclass(frozen=True, eq=False)
class Scene:
    """Terrain, obstacles and meshes of a mission; frame `n`, the water's surface at D = 0."""

    name: str
    terrain: Terrain | None
    obstacles: tuple[Obstacle, ...] = ()
    folder: Path | None = None
    description: str = ""
    source: str = ""  # where it comes from, with its terms
    meshes: tuple[PlacedMesh, ...] = ()


def scene_ids() -> list[str]:
    """List the scenes that are shipped."""
    return sorted(p.parent.name for p in content("models", "scenes").glob("*/scene.yaml"))


def find_scene(scene: str | Path) -> Path:
    """Return the folder of a scene, by its id or by its path (or that of its scene.yaml)."""
    path = Path(scene).expanduser()
    if isinstance(scene, str) and scene in scene_ids():
        return content("models", "scenes", scene)
    if path.name == "scene.yaml" and path.is_file():
        return path.parent
    if (path / "scene.yaml").is_file():
        return path
    known = scene_ids()
    raise InputInvalid(
        f"there is no scene {str(scene)!r}",
        (
            f"{expected_names(scene, known)}, or the path of a folder with a "
            "scene.yaml (`uuvsim terrain CHART -o FOLDER` writes one)"
        ),
    )


def load_scene(scene: str | Path) -> Scene:
    """Read a scene, by id or path; raises `InputInvalid` with all mistakes of its files."""
    folder = find_scene(scene)
    problems: list[Problem] = []
    terrain = None
    meshes: list[PlacedMesh] = []

    def mistakes(data: Any) -> Iterator[tuple[int, str]]:
        for i, entry in enumerate(data.get("obstacles", ())):
            for shape, given in entry.items():
                if shape not in _SHAPES:
                    text = f"obstacles.{i}: {shape!r}; expected {expected_names(shape, _SHAPES)}"
                    yield line_of(data, ["obstacles", i]), text
                    continue
                for name, value in given.items():
                    numbers = value if isinstance(value, list) else [value]
                    if any(isinstance(v, float) and not isfinite(v) for v in numbers):
                        place = ["obstacles", i, shape, name]
                        text = f"{'.'.join(map(str, place))}: {value}; expected finite numbers"
                        yield line_of(data, place), text
        yield from _read_meshes(data, folder, meshes)

    try:
        data = read_yaml(folder / "scene.yaml", "scene.schema.json", mistakes)
    except ParameterInvalid as error:
        problems += error.problems
        data = None
    name = "terrain.npz" if data is None else data.get("terrain")
    if name is not None and (data is not None or (folder / name).is_file()):
        try:
            terrain = load_terrain(folder / str(name))
        except InputInvalid as error:
            problems += error.problems
    if problems or data is None:
        raise InputInvalid.of(problems)
    obstacles: list[Obstacle] = []
    for entry in data.get("obstacles", ()):
        ((shape, given),) = entry.items()
        values: dict[str, Any] = {
            str(name): tuple(float(v) for v in value)
            if isinstance(value, list)
            else str(value)
            if name in ("name", "material")
            else float(value)
            for name, value in given.items()
        }
        obstacles.append(_SHAPES[str(shape)](**values))
    return Scene(
        str(data["id"]),
        terrain,
        tuple(obstacles),
        folder,
        str(data["description"]),
        str(data["source"]),
        tuple(meshes),
    )


def _read_meshes(data: Any, folder: Path, meshes: list[PlacedMesh]) -> Iterator[tuple[int, str]]:
    """Read the meshes of a scene into a list; yield line and text of each mistake."""
    for i, entry in enumerate(data.get("meshes", ())):
        line = line_of(data, ["meshes", i, "file"])
        vectors = {
            key: tuple(float(v) for v in entry[key])
            for key in ("position", "orientation")
            if key in entry
        }
        numbers = [v for vector in vectors.values() for v in vector] + [entry.get("scale", 1.0)]
        if not all(isfinite(v) for v in numbers):
            yield line, f"meshes.{i}: {numbers}; expected finite numbers"
            continue
        words = {key: str(entry[key]) for key in _WORDS if key in entry}
        scale = float(entry.get("scale", 1.0))
        contact = bool(entry.get("contact", True))
        given: Any = {**vectors, **words, "scale": scale, "contact": contact}
        try:
            meshes.append(placed_mesh(folder / str(entry["file"]), **given))
        except InputInvalid as error:
            yield line, f"meshes.{i}: {error}"
    total = sum(len(m.corners) for m in meshes)
    if total > MOST_TRIANGLES:
        line = line_of(data, ["meshes"])
        yield line, f"meshes: {total:,} triangles together; expected at most {MOST_TRIANGLES:,}"


def save_scene(scene: Scene, folder: Path) -> None:
    """Write a scene's folder: scene.yaml, terrain.npz where it has a terrain, and its meshes.

    Raises `InputInvalid` where two meshes have files of one name in different folders.
    """
    folder.mkdir(parents=True, exist_ok=True)
    files = {m.file.name: m.file.resolve() for m in scene.meshes}
    for mesh in scene.meshes:
        if files[mesh.file.name] != mesh.file.resolve():
            raise InputInvalid(
                f"{mesh.file} and {files[mesh.file.name]}: expected files of different names, for "
                "a scene has its meshes beside scene.yaml"
            )
    for name, file in files.items():
        parts = gltf_parts(file)
        if any(".." in Path(part).parts or Path(part).is_absolute() for part in parts):
            raise InputInvalid(
                file, "reads files outside of its folder", "files beside or below it"
            )
        for source, target in [
            (file, folder / name), *((file.parent / part, folder / part) for part in parts)
        ]:  # fmt: skip
            if source != target.resolve():
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(source, target)
    if scene.terrain is not None:
        save_terrain(scene.terrain, folder / "terrain.npz")
    file = folder / "scene.yaml"
    file.write_text(headed("scene", _text(scene)), encoding="utf-8")
    keep_schemas(file)


def _text(scene: Scene) -> str:
    lines = [
        f"id: {_quoted(scene.name)}",
        f"description: {_quoted(scene.description or scene.name)}",
        f"source: {_quoted(scene.source or 'not stated')}",
        'units: "m, rad"  # positions are N, E, D from the origin of the local frame',
    ]
    if scene.terrain is not None:
        lines.append("terrain: terrain.npz")
    if scene.obstacles or (scene.terrain is None and not scene.meshes):
        lines.append("obstacles:" if scene.obstacles else "obstacles: []")
    shapes = {made: shape for shape, made in _SHAPES.items()}
    for obstacle in scene.obstacles:
        numbers = ", ".join(
            f"{f.name}: {_value(getattr(obstacle, f.name))}"
            for f in fields(obstacle)
            if getattr(obstacle, f.name) != f.default
        )
        lines.append(f"  - {shapes[type(obstacle)]}: {{{numbers}}}")
    for k, mesh in enumerate(scene.meshes):
        lines += ["meshes:"] * (k == 0)
        vectors = f"position: {_value(mesh.position)}, orientation: {_value(mesh.orientation)}"
        words = [(key, getattr(mesh, key)) for key in _WORDS if getattr(mesh, key)]
        texts = ", ".join(f"{key}: {_quoted(value)}" for key, value in words)
        own = f"file: {_quoted(mesh.file.name)}, {vectors}, scale: {_value(mesh.scale)}, {texts}"
        own += "" if mesh.contact else ", contact: false"
        lines.append(f"  - {{{own}}}")
    return "\n".join(lines) + "\n"


def _value(value: object) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(_value(v) for v in value)}]"
    return _quoted(value) if isinstance(value, str) else f"{float(value):.10g}"  # type: ignore[arg-type]


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)
