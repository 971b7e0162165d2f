"""Recorded signals as pandas' DataFrame and xarray's Dataset, with units (extra ``data``)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from uuvsim_cosim.errors import InputInvalid

if TYPE_CHECKING:
    from uuvsim_cosim.orchestrator.recording.signals import Signals

__all__ = ["to_pandas", "to_xarray"]


def library(name: str) -> Any:
    """Import pandas or xarray; raises InputInvalid with the extra if it is not installed."""
    from importlib import import_module

    try:
        return import_module(name)
    except ImportError as error:
        raise InputInvalid(
            f"{name} is not installed", "pip install 'uuvsim-cosim[data]'"
        ) from error


def to_pandas(signals: Signals) -> Any:
    """Return a DataFrame, see `Signals.to_pandas`."""
    pandas = library("pandas")
    columns: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    for name, values in signals.items():
        flat = values.reshape(len(values), -1)
        numbers = signals.elements.get(name) or range(1, flat.shape[1] + 1)
        for element, number, unit in zip(flat.T, numbers, _units(signals, name), strict=True):
            column = name if values.ndim == 1 else f"{name}[{number}]"
            columns[column], units[column] = element, unit
    frame = pandas.DataFrame(columns, index=pandas.Index(signals.time, name="time"))
    frame.attrs["units"] = {"time": "s", **units}
    return frame


def to_xarray(signals: Signals) -> Any:
    """Return a Dataset, see `Signals.to_xarray`."""
    xarray = library("xarray")
    data: dict[str, Any] = {}
    coordinates: dict[str, Any] = {"time": ("time", signals.time, {"units": "s"})}
    for name, values in signals.items():
        units = _units(signals, name)
        about: dict[str, Any] = {"units": units[0] if len(set(units)) == 1 else list(units)}
        if signals.descriptions.get(name):
            about["long_name"] = signals.descriptions[name]
        if values.ndim == 1:
            data[name] = ("time", values, about)
            continue
        dimension = f"{name}_element"
        numbers = signals.elements.get(name) or range(1, values.shape[1] + 1)
        coordinates[dimension] = (dimension, np.array(numbers))
        data[name] = (("time", dimension), values, about)
    plain = {k: v for k, v in signals.metadata.items() if isinstance(v, str | int | float)}
    return xarray.Dataset(data, coordinates, plain)


def _units(signals: Signals, name: str) -> tuple[str, ...]:
    """Return the unit of each element of a signal."""
    values = signals[name]
    size = 1 if values.ndim == 1 else values.shape[1]
    one: Mapping[str, str] = signals.units
    return signals.element_units.get(name) or (one.get(name, ""),) * size
