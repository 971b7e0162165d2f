"""A hull from its surface: closed forms of box, sphere, spheroid, and files that are none."""

from __future__ import annotations

import struct
from math import pi
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from uuvsim_cosim.cli import status_of
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.checks.checks import checks_of
from uuvsim_cosim.models.importing.import_mesh import (
    added_mass_of,
    drag_coefficients,
    import_mesh,
    quadratic_drag,
)
from uuvsim_cosim.models.shapes.ellipsoid import added_mass
from uuvsim_cosim.models.shapes.mesh import read_mesh, repaired, silhouette, solid_of

Array = NDArray[np.float64]


def box(length: float, breadth: float, height: float) -> Array:
    """Twelve triangles, outside anticlockwise."""
    c = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [f for a, b, d, e in quads for f in ((a, b, d), (a, d, e))]
    return c[np.array(faces)] * np.array([length, breadth, height]) / 2


def spheroid(a: float, b: float, n: int = 48) -> Array:
    """A spheroid of semi-axes a, b, b by rings of quadrilaterals, cut in two."""
    theta, phi = np.linspace(0, pi, n + 1), np.linspace(0, 2 * pi, 2 * n + 1)[:-1]

    def at(i: int, j: int) -> tuple[float, float, float]:
        if i in (0, n):
            return (a if i == 0 else -a, 0.0, 0.0)
        s = np.sin(theta[i])
        angle = phi[j % (2 * n)]
        return (
            float(a * np.cos(theta[i])),
            float(b * s * np.cos(angle)),
            float(b * s * np.sin(angle)),
        )

    out = []
    for i in range(n):
        for j in range(2 * n):
            p, q, r, s = at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)
            out += [t for t in ((p, q, r), (p, r, s)) if len(set(t)) == 3]
    return np.array(out)


def binary(path: Path, triangles: Array) -> Path:
    data = b"\0" * 80 + struct.pack("<I", len(triangles))
    for t in triangles:
        data += struct.pack("<12fH", 0, 0, 0, *t.ravel(), 0)
    path.write_bytes(data)
    return path


def text(path: Path, triangles: Array) -> Path:
    rows = ["solid hull"]
    for t in triangles:
        rows += [
            "facet normal 0 0 0",
            "outer loop",
            *(f"vertex {x!r} {y!r} {z!r}" for x, y, z in t.tolist()),
        ]
        rows += ["endloop", "endfacet"]
    path.write_text("\n".join([*rows, "endsolid hull", ""]))
    return path


def test_volume_centre_and_inertia_of_a_box_are_exact() -> None:
    mesh = repaired(box(1.0, 0.6, 0.4) + np.array([3.0, -2.0, 1.0]), "box")
    solid = solid_of(mesh)
    assert solid.volume == pytest.approx(0.24, rel=1e-12)
    assert solid.centre == pytest.approx([3.0, -2.0, 1.0], rel=1e-12)
    squares = np.array([1.0, 0.36, 0.16])
    expected = np.diag(12.0 / 12.0 * (squares.sum() - squares))
    assert solid.inertia(12.0) == pytest.approx(expected, rel=1e-10, abs=1e-12)
    assert solid.areas == pytest.approx([0.24, 0.4, 0.6], rel=1e-12)


@pytest.mark.parametrize(("a", "b"), [(0.2, 0.2), (0.8, 0.1), (0.1, 0.3)])
def test_a_spheroid_has_its_closed_forms_within_the_meshing_error(a: float, b: float) -> None:
    mesh = repaired(spheroid(a, b), "spheroid")
    solid = solid_of(mesh)
    error = 3e-3  # of 48 rings: the volume inside flat facets
    assert solid.volume == pytest.approx(4 / 3 * pi * a * b * b, rel=error)
    inertia = [2 * b * b, a * a + b * b, a * a + b * b]
    assert np.diag(solid.inertia(5.0)) == pytest.approx(inertia, rel=2 * error)
    assert solid.areas == pytest.approx([pi * b * b, pi * a * b, pi * a * b], rel=2 * error)
    M_A, _ = added_mass_of(solid, 1000.0)
    expected = np.array(added_mass(a, b, b, 1000.0))
    assert np.diag(M_A) == pytest.approx(expected, rel=2 * error, abs=1e-3 * expected.max())


def test_a_sphere_has_half_its_water_as_added_mass_and_no_drag_when_it_turns() -> None:
    mesh = repaired(spheroid(0.2, 0.2), "sphere")
    solid = solid_of(mesh)
    M_A, semi = added_mass_of(solid, 1000.0)
    assert np.diag(M_A)[:3] == pytest.approx(500.0 * solid.volume, rel=1e-3)
    assert semi == pytest.approx(0.2, rel=2e-3)
    D_q = quadratic_drag(mesh, solid, 1000.0, drag_coefficients(mesh, solid)[1])
    assert D_q[:3] == pytest.approx(0.5 * 1000 * 0.5 * pi * 0.04, rel=0.06)
    assert not D_q[3:].any()


@pytest.mark.parametrize("size", [0.05, 4.0])
def test_a_slender_spheroid_has_hoerner_s_drag_at_any_size(size: float) -> None:
    mesh = repaired(spheroid(4 * size, size), "spheroid")
    least, C_D, most = drag_coefficients(mesh, solid_of(mesh))
    assert (least < C_D).all()
    assert (most > C_D).all()
    fineness = 4.0  # length over breadth, which is both over 2 √(area / π)
    hoerner = 0.44 / fineness + 0.02 * fineness + 0.02 / fineness**0.5
    assert C_D[0] == pytest.approx(hoerner, rel=0.01)
    assert C_D[1] == pytest.approx(1.1 - 0.6 / 4.0, rel=0.01)  # across: e = 1 / √4 < 1


def test_the_drag_of_a_box_that_turns_is_that_of_its_strips() -> None:
    mesh = repaired(box(0.457, 0.338, 0.25), "box")
    solid = solid_of(mesh)
    D_q = quadratic_drag(mesh, solid, 1000.0, drag_coefficients(mesh, solid)[1])
    a, b, h = 0.457 / 2, 0.338 / 2, 0.25
    assert D_q[0] == pytest.approx(0.5 * 1000 * 1.05 * 0.338 * 0.25, rel=1e-9)
    assert D_q[5] == pytest.approx(0.5 * 1000 * 1.05 * h * (a**4 + b**4) / 2, rel=1e-6)


def test_a_turned_spheroid_has_the_turned_added_mass() -> None:
    c, s = np.cos(0.4), np.sin(0.4)
    R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    M_A, _ = added_mass_of(solid_of(repaired(spheroid(0.8, 0.2, 24) @ R.T, "turned")), 1000.0)
    straight, _ = added_mass_of(solid_of(repaired(spheroid(0.8, 0.2, 24), "straight")), 1000.0)
    assert M_A[:3, :3] == pytest.approx(R @ straight[:3, :3] @ R.T, abs=1e-3 * straight.max())


def test_a_shadow_counts_overlapping_parts_once() -> None:
    two = np.concatenate([box(1, 1, 1), box(1, 1, 1) + np.array([0.0, 3.0, 0.5])])
    at, widths = silhouette(two, 0, 2)
    assert widths.sum() * (at[1] - at[0]) == pytest.approx(1.5)


@pytest.mark.parametrize("write", [binary, text])
def test_both_kinds_of_stl_are_read_and_make_a_vehicle_that_holds_its_checks(
    write: object,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "hull.stl", 1000 * box(0.457, 0.338, 0.25))  # type: ignore[operator]
    arguments = ["hull.stl", "--mass", "11.5", "--scale", "0.001", "--volume", "0.0114"]
    arguments += ["--added-mass", "ellipsoid"]
    assert not status_of(["models", "import", *arguments, "-o", "my_rov"])
    said = capsys.readouterr().out
    assert "0.0386" in said
    assert "estimated" in said
    assert all(c.holds for c in checks_of("my_rov"))
    rows = [r for r in Path("my_rov/parameters.yaml").read_text().splitlines() if "value:" in r]
    assert all("unit:" in r and "source:" in r for r in rows)
    assert status_of(["models", "import", *arguments, "-o", "my_rov"]) == 2
    assert "exists already" in capsys.readouterr().err


def test_axes_of_the_file_are_turned_to_frd(tmp_path: Path) -> None:
    # Right, forward, up: the box is longest along the file's y, and sits above the file's origin.
    path = binary(tmp_path / "hull.stl", box(0.3, 0.5, 0.2) + np.array([0.1, 0.2, 0.3]))
    found = import_mesh(path, 30.0, axes="RFU", added_mass="ellipsoid")
    assert found.solid.extent == pytest.approx([0.5, 0.3, 0.2], rel=1e-6)
    assert -found.origin == pytest.approx([0.2, 0.1, -0.3], rel=1e-6)


@pytest.mark.parametrize("which", ["all", "some"])
def test_a_surface_that_is_inside_out_is_refused_unless_it_may_be_turned(which: str) -> None:
    wrong = box(1.0, 0.6, 0.4)
    turned = slice(None) if which == "all" else slice(2, 5)
    wrong[turned] = wrong[turned, ::-1]
    n = 12 if which == "all" else 3
    with pytest.raises(InputInvalid, match=rf"{n} of 12 triangles are inside out.*--turn-inside"):
        repaired(wrong, "box")
    mesh = repaired(wrong, "box", turn=True)
    assert solid_of(mesh).volume == pytest.approx(0.24)
    assert f"{n} of 12 triangles were inside out and are turned" in mesh.notes[0]


def test_the_command_turns_a_surface_that_is_inside_out_if_asked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    binary(tmp_path / "hull.stl", box(1.0, 0.6, 0.4)[:, ::-1])
    arguments = ["models", "import", "hull.stl", "--mass", "240", "--added-mass", "ellipsoid"]
    assert status_of(arguments) == 2
    assert "--turn-inside-out" in capsys.readouterr().err
    assert status_of([*arguments, "--turn-inside-out"]) == 0
    assert "12 of 12 triangles were inside out and are turned" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("unit", "scale"), [("mm", 0.001), ("cm", 0.01), ("inches", 0.0254), ("feet", 0.3048)]
)
def test_the_likely_unit_is_that_in_which_the_hull_displaces_its_mass(
    unit: str, scale: float, tmp_path: Path
) -> None:
    path = binary(tmp_path / "hull.stl", box(0.457, 0.338, 0.25) / scale)
    hint = rf"file in {unit} \(--scale {scale:g} makes it 0\.457 m long\)\?"
    with pytest.raises(InputInvalid, match=f"(?i){hint}"):
        import_mesh(path, 30.0, added_mass="ellipsoid")
    with pytest.raises(InputInvalid, match=f"(?i){hint}"):  # another unit is given
        import_mesh(path, 30.0, scale=0.3 * scale, added_mass="ellipsoid")


def test_a_volume_that_is_hardly_any_of_the_surface_names_the_units(tmp_path: Path) -> None:
    path = binary(tmp_path / "hull.stl", box(18.0, 13.3, 9.8))  # inches
    with pytest.raises(
        InputInvalid, match=r"less than 1 % of the 2346 m3.*inches \(--scale 0\.0254"
    ):
        import_mesh(path, 11.5, volume=0.0114, added_mass="ellipsoid")


def test_a_surface_that_is_no_hull_is_refused_with_its_place() -> None:
    whole = box(1.0, 0.6, 0.4)
    with pytest.raises(InputInvalid, match=r"is open: 3 edges .* at \(-0\.5, 0, -0\.2\) m"):
        repaired(np.delete(whole, 1, axis=0), "b.stl")
    broken = whole.copy()
    broken[4, 1, 2] = np.nan
    with pytest.raises(InputInvalid, match=r"triangle 5 of 12 has the vertex .*nan"):
        repaired(broken, "b.stl")
    with pytest.raises(InputInvalid, match=r"300 m long.*mm \(--scale 0.001 makes it 0.3 m long"):
        repaired(300 * whole, "b.stl")
    with pytest.raises(InputInvalid, match=r"0.0003 m long; expected 0.02 to 150 m$"):
        repaired(0.0003 * whole, "b.stl")


def test_a_closed_surface_that_is_flat_is_refused() -> None:
    with pytest.raises(InputInvalid, match=r"encloses no volume .*closed hull with length"):
        repaired(box(1.0, 1.0, 0.0)[[4, 5, 6, 7]] @ np.diag([1.0, 1.0, 0.0]), "flat.stl")


def test_a_file_that_is_no_stl_is_refused_with_what_was_read(tmp_path: Path) -> None:
    whole = binary(tmp_path / "a.stl", box(1.0, 0.6, 0.4))
    (tmp_path / "short.stl").write_bytes(whole.read_bytes()[:-70])
    with pytest.raises(
        InputInvalid, match=r"truncated: its header announces 12 triangles .* 10 are"
    ):
        read_mesh(tmp_path / "short.stl")
    (tmp_path / "noise.stl").write_bytes(b"GIF89a" + bytes(range(200)))
    with pytest.raises(InputInvalid, match=r"expected an STL"):
        read_mesh(tmp_path / "noise.stl")
    (tmp_path / "tiny.stl").write_bytes(b"x")
    with pytest.raises(InputInvalid, match=r"1 bytes; expected an STL"):
        read_mesh(tmp_path / "tiny.stl")
    lines = text(tmp_path / "b.stl", box(1.0, 0.6, 0.4)).read_text().splitlines()
    (tmp_path / "cut.stl").write_text("\n".join(lines[:-9]))
    with pytest.raises(InputInvalid, match=r"truncated: .* no endsolid"):
        read_mesh(tmp_path / "cut.stl")
    lines[3] = "vertex 0.5 here 1"
    (tmp_path / "word.stl").write_text("\n".join(lines))
    with pytest.raises(InputInvalid, match=r"word.stl:4: 'vertex 0.5 here 1'; expected vertex"):
        read_mesh(tmp_path / "word.stl")


def test_a_mass_that_no_hull_of_that_volume_has_is_refused(tmp_path: Path) -> None:
    path = binary(tmp_path / "a.stl", box(1.0, 0.6, 0.4))  # 246 kg of water
    with pytest.raises(InputInvalid, match=r"2460 kg .* displaces 246 kg .* 49\.2 to 1.23e\+03 kg"):
        import_mesh(path, 2460.0)
    with pytest.raises(InputInvalid, match=r"24\.6 kg .*--volume if it floods"):
        import_mesh(path, 24.6)
    with pytest.raises(InputInvalid, match=r"--mass -3: expected a number above 0"):
        import_mesh(path, -3)
    with pytest.raises(InputInvalid, match=r"--volume 0.3: the surface .* encloses 0.24 m3"):
        import_mesh(path, 246.0, volume=0.3)
    with pytest.raises(InputInvalid, match=r"--z-g 0.3: .* outside of the hull, .* -0.2 to 0.2 m"):
        import_mesh(path, 246.0, z_g=0.3)
    assert status_of(["models", "import", str(path)]) == 2


def test_a_mass_near_the_displaced_one_is_a_known_difference_and_another_fails_the_check(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    binary(tmp_path / "a.stl", box(1.0, 0.6, 0.4))
    for name, mass, holds in (("near", "230", True), ("far", "123", False)):
        arguments = ["a.stl", "--mass", mass, "--added-mass", "ellipsoid", "-o", name]
        assert not status_of(["models", "import", *arguments])
        assert (Path(name) / "checks.yaml").exists() == holds
        assert (status_of(["models", "check", name]) == 0) == holds


def test_a_hull_that_is_lighter_than_its_water_says_so_and_why(tmp_path: Path) -> None:
    path = binary(tmp_path / "a.stl", box(1.0, 0.6, 0.4))
    found = import_mesh(path, 225.0, added_mass="ellipsoid")
    assert "floats up" in found.draft.known["weight is near buoyancy"]
    far = import_mesh(path, 100.0, added_mass="ellipsoid")
    assert not far.draft.known
    assert any("--volume" in n and "models check fails" in n for n in far.notes)


def test_several_bodies_are_said_and_that_they_overlap(tmp_path: Path) -> None:
    hull = box(1.0, 0.6, 0.4)

    def notes_of(triangles: Array, mass: float) -> tuple[str, ...]:
        path = binary(tmp_path / "a.stl", triangles)
        return import_mesh(path, mass, added_mass="ellipsoid").notes

    for move, said in (([0.0, 2.0, 0.0], False), ([0.3, 0.0, 0.0], True)):
        notes = notes_of(np.concatenate([hull, hull + np.array(move)]), 400.0)
        assert notes[0].startswith("2 bodies that do not touch are added up")
        assert ("bodies 1 and 2 overlap" in notes[0]) == said
    assert not any("bodies" in n for n in notes_of(hull, 200.0))


def test_other_formats_are_read_by_trimesh(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    )
    assert solid_of(read_mesh(tmp_path / "a.obj")).volume == pytest.approx(1 / 6)
    (tmp_path / "b.obj").write_text("nothing")
    with pytest.raises(InputInvalid, match=r"b.obj"):
        read_mesh(tmp_path / "b.obj")
