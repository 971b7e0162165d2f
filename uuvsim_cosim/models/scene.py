"""A scene folder: terrain, obstacles and the water's edge, as `scene.yaml` says."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, fields
from difflib import get_close_matches
from math import isfinite
from pathlib import Path
from typing import Any

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid, ParameterInvalid
from uuvsim_cosim.models.obstacles import Box, Capsule, Cylinder, Obstacle, Sphere
from uuvsim_cosim.models.parameters import line_of, read_yaml
from uuvsim_cosim.models.terrain import Terrain, load_terrain, save_terrain

__all__ = ["Scene", "find_scene", "load_scene", "save_scene", "scene_ids"]

_KINDS: dict[str, type[Obstacle]] = {
    "box": Box,
    "sphere": Sphere,
    "capsule": Capsule,
    "cylinder": Cylinder,
}


@dataclass(frozen=True, eq=False)
class Scene:
    """What stands still in a mission's world; frame `n`, its water surface at D = 0."""

    name: str
    terrain: Terrain | None
    obstacles: tuple[Obstacle, ...] = ()
    folder: Path | None = None
    description: str = ""
    source: str = ""  # where it comes from, with its terms


def scene_ids() -> list[str]:
    """List the scenes that are shipped."""
    return sorted(p.parent.name for p in content("models", "scenes").glob("*/scene.yaml"))


def find_scene(scene: str | Path) -> Path:
    """Give the folder of a scene: a shipped one by its id, or any by its path (or scene.yaml's)."""
    path = Path(scene).expanduser()
    if isinstance(scene, str) and scene in scene_ids():
        return content("models", "scenes", scene)
    if path.name == "scene.yaml" and path.is_file():
        return path.parent
    if (path / "scene.yaml").is_file():
        return path
    known = scene_ids()
    near = get_close_matches(str(scene), known, n=3) or known
    raise InputInvalid(
        f"there is no scene {str(scene)!r}; expected {''.join(f'{id}, ' for id in near)}"
        "the path of a folder with a scene.yaml (`uuvsim terrain CHART -o FOLDER` writes one)"
    )


def load_scene(scene: str | Path) -> Scene:
    """Read a scene, by id or path; raises `InputInvalid` with all mistakes of its files."""
    folder = find_scene(scene)
    problems, terrain = [], None
    try:
        data = read_yaml(folder / "scene.yaml", "scene.schema.json", _mistakes)
    except ParameterInvalid as error:
        problems.append(str(error))
        data = None
    name = str(data["terrain"]) if data is not None and "terrain" in data else "terrain.npz"
    if (data is not None and "terrain" in data) or (data is None and (folder / name).is_file()):
        try:
            terrain = load_terrain(folder / name)
        except InputInvalid as error:
            problems.append(str(error))
    if problems or data is None:
        raise InputInvalid("\n  ".join(problems))
    obstacles = tuple(_obstacle(entry) for entry in data.get("obstacles", ()))
    return Scene(
        str(data["id"]),
        terrain,
        obstacles,
        folder,
        str(data["description"]),
        str(data["source"]),
    )


def _mistakes(data: Any) -> Iterator[tuple[int, str]]:
    for i, entry in enumerate(data.get("obstacles", ())):
        for kind, said in entry.items():
            if kind not in _KINDS:
                near = get_close_matches(str(kind), _KINDS, 1) or _KINDS
                line = line_of(data, ["obstacles", i])
                yield line, f"obstacles.{i}: {kind!r}; expected {' or '.join(near)}"
                continue
            for name, value in said.items():
                numbers = value if isinstance(value, list) else [value]
                if any(isinstance(v, float) and not isfinite(v) for v in numbers):
                    line = line_of(data, ["obstacles", i, kind, name])
                    yield line, f"obstacles.{i}.{kind}.{name}: {value}; expected finite numbers"


def _obstacle(entry: Any) -> Obstacle:
    ((kind, said),) = entry.items()
    values = {
        str(name): tuple(float(v) for v in value)
        if isinstance(value, list)
        else str(value)
        if name == "name"
        else float(value)
        for name, value in said.items()
    }
    made: Any = _KINDS[str(kind)]
    obstacle: Obstacle = made(**values)
    return obstacle


def save_scene(scene: Scene, folder: Path) -> None:
    """Write a scene's folder: scene.yaml, and terrain.npz where it has a terrain."""
    folder.mkdir(parents=True, exist_ok=True)
    if scene.terrain is not None:
        save_terrain(scene.terrain, folder / "terrain.npz")
    (folder / "scene.yaml").write_text(_text(scene), encoding="utf-8")


def _text(scene: Scene) -> str:
    lines = [
        f"id: {_quoted(scene.name)}",
        f"description: {_quoted(scene.description or scene.name)}",
        f"source: {_quoted(scene.source or 'not stated')}",
        'units: "m, rad"  # positions are N, E, D from the origin of the local frame',
    ]
    if scene.terrain is not None:
        lines.append("terrain: terrain.npz")
    if scene.obstacles or scene.terrain is None:
        lines.append("obstacles:" if scene.obstacles else "obstacles: []")
    kinds = {made: kind for kind, made in _KINDS.items()}
    for obstacle in scene.obstacles:
        said = ", ".join(
            f"{f.name}: {_value(getattr(obstacle, f.name))}"
            for f in fields(obstacle)
            if f.name not in ("name", "yaw") or getattr(obstacle, f.name)
        )
        lines.append(f"  - {kinds[type(obstacle)]}: {{{said}}}")
    return "\n".join(lines) + "\n"


def _value(value: object) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(_value(v) for v in value)}]"
    return _quoted(value) if isinstance(value, str) else f"{float(value):.10g}"  # type: ignore[arg-type]


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)
