"""A netCDF file as named variables: classic ones by SciPy, netCDF-4 by the package netCDF4."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from operator import getitem
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.files_read import noted

__all__ = ["Variable", "read_netcdf"]

Array = NDArray[np.float64]
Index = tuple[slice, ...]
HDF5 = b"\x89HDF"


@dataclass(frozen=True)
class Variable:
    """Dimensions, shape and attributes of a variable; `read` returns a part of it."""

    name: str
    dimensions: tuple[str, ...]
    shape: tuple[int, ...]
    attributes: Mapping[str, Any]
    take: Callable[[Index], Any]

    def read(self, index: Index | None = None) -> Array:
        """Return its numbers, unpacked (scale_factor, add_offset); what is missing is NaN."""
        raw = self.take(index if index is not None else (slice(None),) * len(self.shape))
        values = np.array(raw, dtype=np.float64)
        known = self.attributes
        missing = np.zeros(values.shape, bool)
        for name in ("_FillValue", "missing_value"):
            if name in known:
                missing |= np.isin(values, np.atleast_1d(np.asarray(known[name], np.float64)))
        if "_FillValue" not in known and np.asarray(raw).dtype.kind == "f":
            missing |= np.abs(values) > 9e36  # netCDF's own fill value, 9.96921e36
        values = values * float(known.get("scale_factor", 1.0)) + float(known.get("add_offset", 0))
        values[missing] = np.nan
        return values

    def text(self, name: str) -> str:
        """Return an attribute as text; empty where there is none."""
        value = self.attributes.get(name, "")
        return (
            value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
        ).strip()


def read_netcdf(file: Path) -> dict[str, Variable]:
    """Return the variables of a file; raises InputInvalid for one that is no netCDF."""
    try:
        with noted(file).open("rb") as stream:
            head = stream.read(4)
    except OSError as error:
        raise InputInvalid(f"{file}: cannot be read ({error.strerror})") from None
    try:
        if head[:3] == b"CDF" and head[3:4] in (b"\x01", b"\x02"):
            from scipy.io import netcdf_file

            # The numbers are copied as they are read: a file that is mapped could not be closed.
            with netcdf_file(str(file), "r", mmap=False, maskandscale=False) as read:
                return {
                    name: Variable(
                        name,
                        tuple(v.dimensions),
                        tuple(v.data.shape),
                        dict(vars(v)["_attributes"]),
                        partial(getitem, v.data),
                    )
                    for name, v in read.variables.items()
                }
        if head == HDF5 or head[:3] == b"CDF":
            return _netcdf4(file)
    except InputInvalid:
        raise
    except Exception as reason:
        raise InputInvalid(f"{file}: a netCDF file that cannot be read: {reason}") from None
    raise InputInvalid(f"{file}: no netCDF file (it begins with {head!r})")


def _netcdf4(file: Path) -> dict[str, Variable]:
    try:
        import netCDF4
    except ImportError:
        raise InputInvalid(
            f"{file}: is netCDF-4, which the package netCDF4 reads; "
            "pip install 'uuvsim-cosim[scene]', or nccopy -k classic"
        ) from None

    def take(name: str, index: Index) -> Any:
        with netCDF4.Dataset(str(file)) as again:
            again.set_auto_maskandscale(False)
            return again.variables[name][index]

    found = {}
    with netCDF4.Dataset(str(file)) as read:
        for name, v in read.variables.items():
            if v.dtype is not str and np.dtype(v.dtype).kind in "fiu":
                attributes = {a: v.getncattr(a) for a in v.ncattrs()}
                found[name] = Variable(name, v.dimensions, v.shape, attributes, partial(take, name))
    return found
