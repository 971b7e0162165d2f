"""Figure of vehicles: hull, thrusters and fins as the files state them."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.actuators.fins import fin_geometry
from uuvsim_cosim.models.actuators.thruster_geometry import thruster_geometry
from uuvsim_cosim.models.declaration.parameter_files import (
    propelled_ids,
    vehicle_folder,
    vehicle_ids,
    vehicle_size,
)
from uuvsim_cosim.models.importing.new_vehicle import write_vehicle
from uuvsim_cosim.view.scene3d.vehicle_figure import ACROSS, TOWARDS, vehicle_figure

DOCS = Path(__file__).parents[3] / "docs"
SVG = "{http://www.w3.org/2000/svg}"


def panels(figure: str) -> dict[str, ET.Element]:
    found = {}
    for group in ET.fromstring(figure).findall(f"{SVG}g"):
        title = group.find(f"{SVG}text")
        assert title is not None
        found[str(title.text)] = group
    return found


def parts(panel: ET.Element, kind: str) -> list[np.ndarray]:
    texts = [p.get("d", "") for p in panel.findall(f"{SVG}path") if p.get("class") == kind]
    return [np.array(re.findall(r"[-\d.]+", t), float).reshape(-1, 2) for t in texts]


def test_the_picture_of_the_docs_is_that_of_the_files() -> None:
    """Write it anew by `uuvsim models picture -o docs/images/vehicles.svg`."""
    page = (DOCS / "vehicles" / "vehicles.md").read_text(encoding="utf-8")
    assert "(../images/vehicles.svg)" in page
    drawn = (DOCS / "images" / "vehicles.svg").read_text(encoding="utf-8")
    assert drawn == vehicle_figure()
    assert list(panels(drawn)) == list(vehicle_ids())


@pytest.mark.parametrize("id", vehicle_ids())
def test_each_thruster_and_fin_is_drawn_at_its_place(id: str) -> None:
    panel = panels(vehicle_figure([id]))[id]
    size = vehicle_size(id)
    assert size is not None
    bar = next(p for p in panel.findall(f"{SVG}path") if p.get("class") is None)
    label = panel.findall(f"{SVG}text")[1].text or ""
    scale = float(str(bar.get("d")).split("h")[1]) / float(label.split()[0])  # px/m
    hull = np.concatenate(parts(panel, "hull"))
    middle = 0.5 * (hull.max(axis=0) + hull.min(axis=0)) / scale  # that of the hull's middle
    fins = parts(panel, "fin")
    if (vehicle_folder(id) / "fins.yaml").is_file():
        places = fin_geometry(id).r
        assert len(fins) == len(places)
        expected = (places - size.at) @ ACROSS.T
        found = np.array([f.mean(axis=0) for f in fins]) / scale - middle
        for place in expected:
            assert np.abs(found - place).max(axis=1).min() < 0.02 * size.length
    else:
        assert fins == []
    at = thruster_geometry(id).r if id in propelled_ids() else np.empty((0, 3))
    expected = (at - size.at) @ ACROSS.T
    walls = [p for p in parts(panel, "thruster") if len(p) == 4]
    assert len(walls) == 12 * len(expected)
    found = np.array([w.mean(axis=0) for w in walls]).reshape(-1, 2) / scale - middle
    unit = np.cbrt(size.length * size.breadth * size.height)
    for place in expected:
        near = np.sort(np.abs(found - place).max(axis=1))[:12]
        assert near.max() < 0.13 * unit + 2 / scale


def test_the_axes_of_the_picture_are_orthonormal_and_right_handed() -> None:
    right, down = ACROSS
    basis = np.stack([right, down, -TOWARDS])  # away from the viewer
    np.testing.assert_allclose(basis @ basis.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(basis) == pytest.approx(1.0)
    assert right[0] > 0  # ahead
    assert down[2] > 0


def test_a_vehicle_of_a_user_is_drawn_and_one_without_size_is_refused(tmp_path: Path) -> None:
    folder = write_vehicle("my_rov", tmp_path, "box")
    assert 'class="hull"' in vehicle_figure([str(folder)])
    file = folder / "parameters.yaml"
    rows = file.read_text(encoding="utf-8").splitlines(keepends=True)
    file.write_text("".join(r for r in rows if not r.startswith("size:")), encoding="utf-8")
    with pytest.raises(InputInvalid, match="no size"):
        vehicle_figure([str(folder)])
