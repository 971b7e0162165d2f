"""Added mass by panels: closed forms, invariants, Capytaine's own solver, and the stored record."""

from __future__ import annotations

import json
import sys
from math import pi
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parent))

from geometry_table import CUBE, CYLINDER, box, cylinder, ellipsoid, profile
from rings import across

from uuvsim_cosim.cli import status_of
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.importing.import_mesh import import_mesh
from uuvsim_cosim.models.importing.panel_method import RECORD, by_panels, extrapolated
from uuvsim_cosim.models.shapes.ellipsoid import added_mass
from uuvsim_cosim.models.shapes.mesh import Mesh, repaired
from uuvsim_cosim.models.shapes.panels import panel_meshes

Array = NDArray[np.float64]


def stl(path: Path, triangles: Array) -> Path:
    rows = ["solid hull"]
    for t in triangles.tolist():
        rows += [
            "facet normal 0 0 0",
            "outer loop",
            *(f"vertex {x!r} {y!r} {z!r}" for x, y, z in t),
        ]
        rows += ["endloop", "endfacet"]
    path.write_text("\n".join([*rows, "endsolid hull", ""]))
    return path


def solved(triangles: Array) -> Array:
    return by_panels(repaired(triangles, "hull"), "hull", "").values


@pytest.mark.slow
def test_a_triaxial_ellipsoid_has_lamb_s_added_mass_within_one_per_cent() -> None:
    pytest.importorskip("capytaine")
    result = by_panels(repaired(ellipsoid(0.5, 0.3, 0.2, 48), "hull"), "hull", "")
    expected = np.array(added_mass(0.5, 0.3, 0.2, 1.0))
    assert np.diag(result.values) == pytest.approx(expected, rel=0.01)
    assert not (result.values - np.diag(np.diag(result.values))).any()
    assert (np.abs(np.diag(result.values) - expected) < 2 * np.diag(result.half_widths)).all()


def test_a_cube_has_its_published_added_mass_and_a_sphere_none_in_rotation() -> None:
    pytest.importorskip("capytaine")
    cube = solved(box(1.0, 1.0, 1.0))
    assert np.diag(cube)[:3] == pytest.approx(CUBE, rel=0.003)
    sphere = solved(ellipsoid(0.5, 0.5, 0.5, 24))
    assert np.diag(sphere)[:3] == pytest.approx(pi / 12, rel=0.01)
    assert not np.diag(sphere)[3:].any()


def coefficient(length: float, cuts: int = 6) -> float:
    """Added mass across a cylinder of diameter 1 over its volume, by rings of sources."""
    return across(profile(length, cuts)) / (pi / 4 * length)


def test_rings_of_sources_have_lamb_s_added_mass_of_a_spheroid() -> None:
    polar = np.linspace(0.0, pi, 121)
    meridian = np.stack([-2.5 * np.cos(polar), 0.5 * np.sin(polar)], axis=1)
    assert across(meridian) == pytest.approx(added_mass(2.5, 0.5, 0.5, 1.0)[1], rel=2e-3)


def test_the_ends_of_a_long_cylinder_cost_as_much_as_those_of_a_longer_one() -> None:
    """A published table of 0.90 at 5 and 0.96 at 9 diameters has a third less of it at 9."""
    ends = [length * (1.0 - coefficient(length)) for length in (5.0, 9.0)]
    assert ends[1] == pytest.approx(ends[0], rel=0.05)
    published = [length * (1.0 - CYLINDER[length]) for length in (5.0, 9.0)]
    assert published[1] < 0.75 * published[0]


@pytest.mark.slow
@pytest.mark.parametrize("length", CYLINDER)
def test_a_cylinder_across_its_axis_has_the_added_mass_of_rings_of_sources(length: float) -> None:
    pytest.importorskip("capytaine")
    by_rings = across(profile(length))
    assert solved(cylinder(length, 1.0))[1, 1] == pytest.approx(by_rings, rel=5e-3)


@pytest.mark.slow
def test_a_hull_without_symmetry_has_the_turned_and_shifted_matrix() -> None:
    pytest.importorskip("capytaine")
    c, s = np.cos(0.4), np.sin(0.4)
    R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    r = np.array([0.1, -0.2, 0.05])
    straight = solved(box(1.0, 0.6, 0.4))
    moved = solved(box(1.0, 0.6, 0.4) @ R.T + r)
    turn = np.kron(np.eye(2), R)
    S = np.array([[0, -r[2], r[1]], [r[2], 0, -r[0]], [-r[1], r[0], 0]])
    shift = np.eye(6)
    shift[:3, 3:] = -S  # velocity at the centre of the box, from that at the origin
    expected = shift.T @ turn @ straight @ turn.T @ shift
    size = np.sqrt(np.diag(expected))
    assert moved / np.outer(size, size) == pytest.approx(expected / np.outer(size, size), abs=0.01)


def test_parts_between_mirror_planes_have_the_matrix_of_capytaine_s_solver_on_the_whole() -> None:
    capytaine = pytest.importorskip("capytaine")
    result = by_panels(Mesh(box(1.0, 0.6, 0.4)), "hull", "")
    panels = panel_meshes(Mesh(box(1.0, 0.6, 0.4)))
    whole = panels.meshes[0]
    for axis in panels.mirrored:
        image = whole * np.where(np.arange(3) == axis, -1.0, 1.0)
        whole = np.concatenate([whole, image[:, ::-1]])
    assert len(whole) == result.panels[0]
    faces = np.arange(3 * len(whole)).reshape(-1, 3)
    mesh = capytaine.Mesh(whole.reshape(-1, 3), np.concatenate([faces, faces[:, :1]], axis=1))
    dofs = capytaine.rigid_body_dofs(rotation_center=(0, 0, 0))
    body = capytaine.FloatingBody(mesh, dofs=dofs)
    solver = capytaine.BEMSolver(
        green_function=capytaine.Delhommeau(
            tabulation_nr=0, tabulation_nz=0, tabulation_cache_dir=None
        )
    )
    for axis, dof in ((0, "Surge"), (4, "Pitch")):
        problem = capytaine.RadiationProblem(
            body=body, free_surface=np.inf, water_depth=np.inf, rho=1.0, radiating_dof=dof
        )
        found = solver.solve(problem, keep_details=False).added_masses
        expected = [found[name] for name in body.dofs]
        # Capytaine's integrals over far panels depend on the order of their corners.
        assert result.meshes[0][axis] == pytest.approx(expected, rel=1e-4, abs=1e-5)


def test_three_meshes_determine_a_value_with_errors_in_h_and_its_square() -> None:
    exact = np.diag([2.0, 3.0, 4.0, 1.0, 1.0, 1.0])
    meshes = tuple(exact * (1 + 0.1 / k + 0.2 / k**2) for k in (2, 3, 4))
    values, half_widths = extrapolated((2, 3, 4), meshes)
    assert values == pytest.approx(exact)
    assert (np.diag(half_widths) >= 2e-3 * np.diag(exact)).all()
    two, half = extrapolated((1, 2), tuple(exact * (1 + 0.1 / k) for k in (1, 2)))
    assert two == pytest.approx(exact)
    assert np.diag(half) == pytest.approx(0.05 * np.diag(exact))


def test_a_stored_record_serves_the_same_surface_without_capytaine_and_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("capytaine")
    monkeypatch.chdir(tmp_path)
    stl(tmp_path / "a.stl", box(1.0, 0.6, 0.4))
    stl(tmp_path / "b.stl", box(1.0, 0.6, 0.5))
    assert not status_of(["models", "import", "a.stl", "--mass", "246", "-o", "first"])
    record = json.loads(Path("first", RECORD).read_text())
    assert record["capytaine"]
    assert record["panels"] == sorted(record["panels"])
    monkeypatch.setitem(sys.modules, "capytaine", None)
    again = import_mesh("a.stl", 240.0, added_mass="first").draft
    first = import_mesh("a.stl", 246.0, added_mass="first").draft
    assert again.quantities["M_A_33"] == first.quantities["M_A_33"]
    assert again.quantities["M_A_33"].value == pytest.approx(1025 * record["values"][2][2])
    assert "Capytaine" in again.quantities["M_A_33"].source
    with pytest.raises(InputInvalid, match=r"added_mass.json: belongs to the surface"):
        import_mesh("b.stl", 300.0, added_mass="first")
    with pytest.raises(InputInvalid, match=r"added_mass.json: no such file"):
        import_mesh("b.stl", 300.0, added_mass="elsewhere")


def test_without_capytaine_the_ellipsoid_is_used_and_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "capytaine", None)
    path = stl(tmp_path / "a.stl", box(1.0, 0.6, 0.4))
    found = import_mesh(path, 246.0)
    assert any("pip install 'uuvsim-cosim[hydro]'" in note for note in found.notes)
    assert "Lamb" in found.draft.quantities["M_A_11"].source
    assert not found.draft.files
    with pytest.raises(InputInvalid, match="Capytaine is not installed"):
        import_mesh(path, 246.0, added_mass="capytaine")
