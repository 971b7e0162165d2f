"""A seabed as a height field in local NED, and the file that keeps it."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.files_read import noted

__all__ = ["Terrain", "load_terrain", "save_terrain"]

VERSION = 1
# Contents of a file beside the layers, in this order.
_ABOUT = (
    "spacing", "origin", "crs", "northing", "easting", "vertical_datum", "materials", "source",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Terrain:
    """A height field: nodes on a regular grid, two triangles a cell.

    Node (i, j) stands at N = origin[0] + i * spacing, E = origin[1] + j * spacing, in metres of
    the local frame `n`, whose origin is at (northing, easting) of `crs`. The cell between the
    nodes (i, j) and (i+1, j+1) is cut along the diagonal that joins these two.

    `z` (n_N, n_E) [m] is positive down from the `vertical_datum`, NaN where unknown; `sigma` [m] is
    its standard deviation and `material` an index into `materials`, both shaped as `z`. `source`
    is where it comes from, with its terms. Raises InputInvalid for shapes that do not fit.

    Example: a bottom that slopes from 20 m down to 26 m.

    >>> import numpy as np
    >>> from uuvsim_cosim.models import Terrain
    >>> z = np.repeat([[20.0], [22.0], [24.0], [26.0]], 3, axis=1).astype(np.float32)
    >>> Terrain(z, spacing=10.0, origin=(0.0, -10.0)).extent
    (0.0, 30.0, -10.0, 10.0)
    """

    z: NDArray[np.float32]  # m, positive down from the vertical datum; (n_N, n_E); NaN: unknown
    spacing: float  # m, the same both ways
    origin: tuple[float, float]  # m, N and E of node (0, 0)
    sigma: NDArray[np.float32] | None = None  # m, standard deviation of z, shaped as z
    crs: str = ""  # "EPSG:32610"; empty if the grid has no position on Earth
    northing: float = 0.0  # m, of the local frame's origin in crs
    easting: float = 0.0  # m
    vertical_datum: str = ""  # "MLLW"; empty where unknown
    material: NDArray[np.uint8] | None = None  # index into `materials`, shaped as z
    materials: tuple[str, ...] = ()  # names of the seabed's nature: "mud", "sand", ...
    source: str = ""  # where it comes from, with its terms

    def __post_init__(self) -> None:
        if self.z.ndim != 2 or min(self.z.shape) < 2:
            raise InputInvalid(f"terrain: z is {self.z.shape}; at least 2 x 2 nodes are needed")
        if not (np.isfinite(self.spacing) and self.spacing > 0):
            raise InputInvalid(f"terrain: spacing {self.spacing} m; it must be greater than 0")
        for name in ("sigma", "material"):
            layer = getattr(self, name)
            if layer is not None and layer.shape != self.z.shape:
                raise InputInvalid(f"terrain: {name} is {layer.shape}, z is {self.z.shape}")

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Smallest and greatest N, smallest and greatest E [m]."""
        north, east = self.origin
        rows, columns = self.z.shape
        far_north = north + (rows - 1) * self.spacing
        return north, far_north, east, east + (columns - 1) * self.spacing


def save_terrain(terrain: Terrain, file: Path) -> None:
    """Write a terrain as .npz (compressed; the same terrain gives the same bytes)."""
    layers = {"z": np.asarray(terrain.z, np.float32)}
    if terrain.sigma is not None:
        layers["sigma"] = np.asarray(terrain.sigma, np.float32)
    if terrain.material is not None:
        layers["material"] = np.asarray(terrain.material, np.uint8)
    words = {"version": VERSION} | {name: getattr(terrain, name) for name in _ABOUT}
    np.savez_compressed(file, allow_pickle=False, about=np.array(json.dumps(words)), **layers)


def load_terrain(file: Path) -> Terrain:
    """Read a terrain that `save_terrain` wrote; raises `InputInvalid` for anything else."""
    try:
        with np.load(noted(file), allow_pickle=False) as kept:
            about = json.loads(str(kept["about"]))
            layers = {name: kept[name] for name in kept.files if name != "about"}
        if about["version"] != VERSION:
            found = about["version"]
            raise InputInvalid(f"{file}: terrain of version {found}; this reads version {VERSION}")
        words = {name: about[name] for name in _ABOUT}
        words |= {name: tuple(about[name]) for name in ("origin", "materials")}
        return Terrain(
            z=layers["z"], sigma=layers.get("sigma"), material=layers.get("material"), **words
        )
    except InputInvalid:
        raise
    except FileNotFoundError:
        raise InputInvalid(f"{file}: there is no such file; `uuvsim terrain` makes one") from None
    except Exception as error:
        # numpy would advise to load it unsafely
        reason = "it is no archive of arrays" if "pickle" in str(error) else error
        raise InputInvalid(f"{file}: not a terrain that `uuvsim terrain` wrote: {reason}") from None
