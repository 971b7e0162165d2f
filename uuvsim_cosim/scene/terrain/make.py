"""Terrain of any file that describes a seabed: an S-57 cell, a grid, a terrain, a scene."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.near_names import did_you_mean
from uuvsim_cosim.models.worlds.scene import load_scene, scene_ids
from uuvsim_cosim.models.worlds.terrain import Terrain, load_terrain
from uuvsim_cosim.scene.terrain.chart import (
    DescribedTerrain,
    TiledTerrain,
    chart_terrain,
    write_large,
)
from uuvsim_cosim.scene.terrain.grid import piece_of
from uuvsim_cosim.scene.terrain.raster import raster_terrain

__all__ = ["TerrainOptions", "make_large", "make_terrain"]

CHART_RESOLUTION = 10.0  # m


@dataclass(frozen=True)
class TerrainOptions:
    """Options of a terrain; with None, the file decides."""

    resolution: float | None = None  # m; None: 10 m of a chart, a grid's own cells
    around: str | None = None  # "LAT,LON"
    size: str | None = None  # "KM" or "KMxKM"
    land: str | None = None  # height of land above the datum in m, or "unknown"
    relief: int | None = None  # seed
    datum: str | None = None  # that the depths have to be from
    unit: str | None = None  # of a grid that is silent
    positive: str | None = None  # "up" or "down", of a grid
    fill: float = 0.0  # m, reach of bridges over a grid's holes
    crs: str | None = None  # of a grid that states none
    local: bool = False  # a grid's x and y are E and N of the local frame

    @property
    def chart_resolution(self) -> float:
        """The spacing of nodes of a chart [m]."""
        return CHART_RESOLUTION if self.resolution is None else self.resolution

    @property
    def land_height(self) -> float | None:
        """The height of land above the datum [m], NaN if unknown; raises InputInvalid."""
        if self.land is None or self.land == "unknown":
            return None if self.land is None else float("nan")
        try:
            height = float(self.land)
            if not (np.isfinite(height) and 0 < height < 9000):
                raise ValueError
        except ValueError:
            raise InputInvalid(
                f"--land {self.land}", "metres above the datum, more than 0, or unknown"
            ) from None
        return height


def make_terrain(file: Path, options: TerrainOptions) -> DescribedTerrain:
    """Read a file and make its terrain; raises `InputInvalid`."""
    if not file.exists() and str(file) not in scene_ids():
        beside = file.parent.iterdir() if file.parent.is_dir() else ()
        hint = did_you_mean(file.name, [p.name for p in beside])
        raise InputInvalid(file, f"no such file{hint}", "a chart (.000) or a grid")
    placing: dict[str, object] = {"--crs": options.crs, "--local": options.local or None}
    if str(file) in scene_ids() or (file / "scene.yaml").is_file() or file.name == "scene.yaml":
        _refuse_for(file, "a scene", placing)
        scene = load_scene(str(file) if str(file) in scene_ids() else file)
        if scene.terrain is None:
            raise InputInvalid(f"{file}: this scene has no terrain")
        facts = {"scene": scene.description, **_terrain_facts(scene.terrain),
                 "obstacles": str(len(scene.obstacles))}  # fmt: skip
        facts |= {f"mesh {m.name or m.file.name}": m.facts for m in scene.meshes}
        return _checked(
            DescribedTerrain(scene.terrain, scene.obstacles, facts, meshes=scene.meshes), options
        )
    if file.is_dir():
        cells = sorted(file.rglob("*.000"))
        if len(cells) != 1:
            names = ", ".join(str(c.relative_to(file)) for c in cells[:5]) or "none"
            raise InputInvalid(
                f"{file}: expected a folder with one base cell (.000); it has {names}"
            )
        file = cells[0]
    if file.suffix == ".npz":
        _refuse_for(file, "a terrain", placing)
        terrain = load_terrain(file)
        return _checked(DescribedTerrain(terrain, (), _terrain_facts(terrain)), options)
    if file.suffix == ".zip":
        raise InputInvalid(f"{file}: unpack it first; the updates lie beside the base cell (.000)")
    piece = piece_of(options.around, options.size)
    if _is_chart(file):
        _refuse_for(file, "a chart", {"--unit": options.unit, "--positive": options.positive,
                                      "--fill": options.fill or None, **placing})  # fmt: skip
        made = chart_terrain(
            file, options.chart_resolution, piece, options.land_height, options.relief
        )
    else:
        _refuse_for(file, "a grid", {"--land": options.land, "--relief": options.relief})
        made = raster_terrain(
            file, options.resolution, piece,
            unit=options.unit, positive=options.positive, fill=options.fill, crs=options.crs,
            local=options.local,
        )  # fmt: skip
    return _checked(made, options)


def make_large(file: Path, target: Path, options: TerrainOptions) -> TiledTerrain | None:
    """Write a chart's GeoTIFF in tiles if it has too many nodes; else return None."""
    if target.suffix.lower() not in (".tif", ".tiff") or not file.is_file() or not _is_chart(file):
        return None
    if options.relief is not None or options.datum is not None:
        return None  # of a terrain as a whole
    piece = piece_of(options.around, options.size)
    return write_large(file, target, options.chart_resolution, piece, options.land_height)


def _is_chart(file: Path) -> bool:
    if len(file.suffix) == 4 and file.suffix[1:].isdigit():
        return True
    with file.open("rb") as opened:
        head = opened.read(24)
    return len(head) == 24 and head[:5].isdigit() and head[6:7] == b"L"


def _refuse_for(file: Path, what: str, options: dict[str, object]) -> None:
    for name, given in options.items():
        if given is not None:
            raise InputInvalid(f"{name} {given}: not for {what}, which {file.name} is")


def _checked(made: DescribedTerrain, options: TerrainOptions) -> DescribedTerrain:
    """Refuse depths from another datum than the option's: heights are not converted."""
    found, expected = made.terrain.vertical_datum, options.datum
    if expected is None or found.lower() == expected.lower():
        return made
    if not found:
        return replace(
            made,
            terrain=replace(made.terrain, vertical_datum=expected),
            facts={**made.facts, "datum": f"{expected}, as set by --datum"},
        )
    raise InputInvalid(
        f"depths are from {found}, not from {expected}; the height between the two differs from "
        "place to place, and nothing is shifted here"
    )


def _terrain_facts(terrain: Terrain) -> dict[str, str]:
    known = np.isfinite(terrain.z)
    z = terrain.z[known]
    facts = {
        "grid": f"{terrain.z.shape[0]} x {terrain.z.shape[1]} nodes at {terrain.spacing:g} m, "
        f"{terrain.crs or 'no position on Earth'}, origin N {terrain.northing:.9g} "
        f"E {terrain.easting:.9g}",
        "datum": terrain.vertical_datum or "not stated",
        "depth": f"{z.min():.2f} to {z.max():.2f} m" if len(z) else "all unknown",
        "known": f"{100 * known.mean():.1f} % of nodes",
        "seabed's nature": ", ".join(terrain.materials) or "not stated",
        "source": terrain.source or "not stated",
    }
    if terrain.sigma is not None and np.isfinite(terrain.sigma).any():
        facts["uncertainty"] = f"{np.nanmedian(terrain.sigma):.2f} m, the median"
    return facts
