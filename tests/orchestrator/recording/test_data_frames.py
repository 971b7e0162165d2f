"""Signals as DataFrame and Dataset keep values, names, elements and units."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.recording.signals import Signals

TIME = np.array([0.0, 0.1, 0.2])


@pytest.fixture
def signals() -> Signals:
    eta = np.arange(6.0).reshape(3, 2)
    return Signals(
        TIME,
        np.arange(3),
        {"hull.eta": eta, "battery.voltage": np.array([16.0, 15.9, 15.8])},
        {"hull.eta": "", "battery.voltage": "V"},
        {"battery.voltage": "of the supply"},
        {"system": "two", "seed": 7, "messages": []},
        {"hull.eta": ("m", "rad")},
        {"hull.eta": (1, 6)},
    )


def test_a_data_frame_has_a_column_for_each_element_with_its_unit(signals: Signals) -> None:
    frame = signals.to_pandas()
    assert list(frame.columns) == ["hull.eta[1]", "hull.eta[6]", "battery.voltage"]
    assert frame.index.name == "time"
    assert frame.index.tolist() == TIME.tolist()
    assert frame["hull.eta[6]"].tolist() == [1.0, 3.0, 5.0]
    units = {"time": "s", "hull.eta[1]": "m", "hull.eta[6]": "rad", "battery.voltage": "V"}
    assert frame.attrs["units"] == units


def test_a_dataset_has_units_elements_and_provenance(signals: Signals) -> None:
    data = signals.to_xarray()
    assert data["hull.eta"].dims == ("time", "hull.eta_element")
    assert data["hull.eta"].sel({"hull.eta_element": 6}).values.tolist() == [1.0, 3.0, 5.0]
    assert data["hull.eta"].attrs == {"units": ["m", "rad"]}
    assert data["battery.voltage"].attrs == {"units": "V", "long_name": "of the supply"}
    assert data["time"].attrs == {"units": "s"}
    assert data.attrs == {"system": "two", "seed": 7}


@pytest.mark.parametrize(("library", "name"), [("pandas", "to_pandas"), ("xarray", "to_xarray")])
def test_without_the_library_the_extra_is_named(
    library: str, name: str, signals: Signals, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(InputInvalid, match=rf"{library} is not installed.*uuvsim-cosim\[data\]"):
        getattr(signals, name)()
