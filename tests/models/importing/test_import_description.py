"""Vehicles out of URDF, SDF and xacro: frames and signs turned, and every gap said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from lxml import etree

from uuvsim_cosim.cli import status_of
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.actuators.thruster_geometry import configuration_matrix, thruster_geometry
from uuvsim_cosim.models.checks.checks import checks_of
from uuvsim_cosim.models.declaration.parameter_files import parameter_set
from uuvsim_cosim.models.importing.import_description import import_description
from uuvsim_cosim.models.importing.vehicle_draft import write_draft
from uuvsim_cosim.models.importing.xacro import expand, is_xacro, local

URDF = """<?xml version="1.0"?>
<robot name="tiny">
  <link name="base_link">
    <inertial><origin xyz="0.1 0.02 -0.03"/><mass value="100"/>
      <inertia ixx="10" iyy="20" izz="30" ixy="1" ixz="2" iyz="3"/></inertial>
    <collision><geometry><box size="1.0 0.5 0.2"/></geometry></collision>
  </link>
  {more}
</robot>
"""
ARM = """<link name="arm"><inertial><origin xyz="1 0 0"/><mass value="2"/>
  <inertia ixx="1" iyy="2" izz="3" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="j" type="fixed"><parent link="base_link"/><child link="arm"/>
  <origin xyz="0 0 0.5" rpy="0 0 1.5707963267948966"/></joint>"""
WATER = """<gazebo><plugin name="w" filename="libuuv_underwater_object_ros_plugin.so">
  <fluid_density>1028</fluid_density>
  <link name="base_link"><neutrally_buoyant>0</neutrally_buoyant><volume>${volume}</volume>
    <box><width>0.5</width><length>${2 * half}</length><height>0.2</height></box>
    <center_of_buoyancy>0.1 0.02 ${0.1 * half}</center_of_buoyancy>
    <hydrodynamic_model><type>fossen</type>
      <added_mass>50 0 0 0 4 0  0 60 0 -4 0 0  0 0 70 0 0 0  0 -4 0 5 0 0  4 0 0 0 6 0  0 0 0 0 0 7
      </added_mass>
      <linear_damping>-10 -20 -30 -1 -2 -3</linear_damping>
      <linear_damping_forward_speed>-1 0 0 0 0 0</linear_damping_forward_speed>
      <quadratic_damping>-100 -200 -300 -4 -5 -6</quadratic_damping>
    </hydrodynamic_model></link></plugin></gazebo>"""
SDF = """<sdf version="1.9"><world name="w"><model name="ground"><link name="l"/></model>
  <model name="glider"><link name="base">
    <inertial><pose>0 0 -0.02 0 0 0</pose><mass>148</mass>
      <inertia><ixx>3</ixx><iyy>42</iyy><izz>42</izz></inertia></inertial>
    <collision name="c"><pose>0 0 0 0 1.5707963267948966 0</pose>
      <geometry><cylinder><radius>0.15</radius><length>2.05</length></cylinder></geometry></collision>
  </link>
  <plugin filename="gz-sim-hydrodynamics-system" name="gz::sim::systems::Hydrodynamics">
    <link_name>base</link_name><water_density>1000</water_density>
    <xDotU>-5</xDotU><yDotV>-126</yDotV><zDotW>-126</zDotW><mDotQ>-33</mDotQ><nDotR>-33</nDotR>
    <yDotR>7</yDotR><nDotV>7</nDotV><mDotW>2</mDotW><zDotQ>2</zDotQ>
    <xUabsU>-6</xUabsU><yVabsV>-600</yVabsV><yRabsR>12</yRabsR><xU>-1</xU><yRabsV>3</yRabsV>
  </plugin></model></world></sdf>"""


def numbers(path: Path, text: str) -> dict[str, float]:
    path.write_text(text)
    draft = import_description(path).draft
    return {k: q.value for k, q in draft.quantities.items()}


def test_inertials_are_turned_from_flu_to_frd(tmp_path: Path) -> None:
    p = numbers(tmp_path / "a.urdf", URDF.format(more=""))
    assert [p["m"], p["x_g"], p["y_g"], p["z_g"]] == pytest.approx([100, 0.1, -0.02, 0.03])
    assert [p["I_g_11"], p["I_g_22"], p["I_g_33"]] == pytest.approx([10, 20, 30])
    assert [p["I_g_12"], p["I_g_13"], p["I_g_23"]] == pytest.approx([-1, -2, 3])


def test_links_are_added_up_through_their_joints(tmp_path: Path) -> None:
    p = numbers(tmp_path / "a.urdf", URDF.format(more=ARM))
    # The arm's CG is 1 m along x of the joint, which is y (left) of the base, and 0.5 m up.
    r = (100 * np.array([0.1, 0.02, -0.03]) + 2 * np.array([0.0, 1.0, 0.5])) / 102
    assert [p["x_g"], p["y_g"], p["z_g"]] == pytest.approx(r * [1, -1, -1])
    alone = np.array([0.1, 0.02, -0.03])
    d, e = alone - r, np.array([0.0, 1.0, 0.5]) - r
    about_z = 30 + 3 + 100 * (d[0] ** 2 + d[1] ** 2) + 2 * (e[0] ** 2 + e[1] ** 2)
    assert p["I_g_33"] == pytest.approx(about_z)


def test_without_hydrodynamics_they_are_estimated_and_marked(tmp_path: Path) -> None:
    (tmp_path / "a.urdf").write_text(URDF.format(more=""))
    found = import_description(tmp_path / "a.urdf")
    assert found.draft.quantities["M_A_11"].source.startswith("estimated")
    assert found.draft.quantities["nabla"].value == pytest.approx(0.1)
    assert any("no hydrodynamics" in note for note in found.notes)


def test_a_xacro_has_its_properties_and_signs_put_right(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("water.xacro").write_text(
        f'<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:macro name="w" params="ns">'
        f"{WATER}</xacro:macro></robot>"
    )
    more = (
        '<xacro:property name="half" value="0.5"/>'
        '<xacro:property name="volume" value="${100/1025}"/>'
        '<xacro:include filename="$(find tiny)/urdf/water.xacro"/>'
    )
    head = '<robot name="tiny" xmlns:xacro="http://www.ros.org/wiki/xacro">'
    Path("tiny.xacro").write_text(URDF.format(more=more).replace('<robot name="tiny">', head))
    Path("config").mkdir()
    tam = [[1, 0], [0, 1], [0, 0], [0, 0], [0, 0], [-0.2, 0.4]]  # FLU: one ahead, one to the left
    Path("config/TAM.yaml").write_text(f"tam: {tam}\n")
    assert not status_of(["models", "import", "tiny.xacro", "-o", "tiny"])
    quantities = parameter_set("tiny").quantities
    assert any("box of" in q.source for q in quantities.values())  # not of <collision>
    p = {k: q.value for k, q in quantities.items()}
    assert p["nabla"] == pytest.approx(100 / 1025)
    assert p["rho"] == 1028
    assert [p["x_b"], p["y_b"], p["z_b"]] == pytest.approx([0.1, -0.02, -0.05])
    assert [p["M_A_11"], p["M_A_15"], p["M_A_24"], p["M_A_66"]] == [50, 4, -4, 7]  # FRD already
    assert [p["D_l_11"], p["D_q_33"], p["D_u_11"]] == [10, 300, 1]
    assert all(c.holds or c.known for c in checks_of("tiny"))
    T = configuration_matrix(thruster_geometry(str(Path("tiny").absolute())))
    turn = np.diag([1, -1, -1, 1, -1, -1])
    assert pytest.approx(turn @ np.array(tam, dtype=float)) == T
    assert "tiny/thrusters.yaml" in capsys.readouterr().out


PARTS = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:macro name="even_box" params="m x:=1 y:=1 *pose"><inertial><mass value="${m}"/>
    <xacro:insert_block name="pose"/>
    <inertia ixx="${m*(y*y+1)/12}" iyy="${m*(x*x+1)/12}" izz="${m*(x**2+y**2)/12}"/></inertial>
  </xacro:macro>
  <xacro:macro name="thruster" params="ns id *pose m:=^|9">
    <joint name="${ns}/j${id}" type="fixed"><xacro:insert_block name="pose"/>
      <parent link="${ns}/base"/><child link="${ns}/t${id}"/></joint>
    <link name="${ns}/t${id}"><xacro:even_box m="${m}"><origin xyz="0 0 0"/></xacro:even_box></link>
  </xacro:macro>
  <xacro:macro name="nobody_calls_me" params="q"><link name="x"><inertial><mass value="${q}"/>
    </inertial></link></xacro:macro>
</robot>"""
CALLS = """<robot name="mine" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="ns" default="mine"/>
  <xacro:include filename="$(find mine)/urdf/parts.xacro"/>
  <xacro:macro name="base" params="ns heavy"><link name="${ns}/base">
    <xacro:even_box m="100" x="2"><origin xyz="0 0 -0.1"/></xacro:even_box>
    <collision><geometry><box size="2 1 1"/></geometry></collision></link>
    <xacro:if value="${heavy and ns == 'mine'}">
      <xacro:thruster ns="${ns}" id="1" m="4"><origin xyz="0 0.5 0"/></xacro:thruster></xacro:if>
    <xacro:unless value="${heavy}">
      <xacro:thruster ns="${ns}" id="2" m="50"><origin xyz="0 0 0"/></xacro:thruster></xacro:unless>
  </xacro:macro>
  <xacro:base ns="$(arg ns)" heavy="true"/>
</robot>"""


def test_macros_are_put_in_the_place_of_their_calls(tmp_path: Path) -> None:
    (tmp_path / "parts.xacro").write_text(PARTS)
    p = numbers(tmp_path / "mine.xacro", CALLS)
    assert p["m"] == 104
    assert [p["y_g"], p["z_g"]] == pytest.approx([-4 * 0.5 / 104, 100 * 0.1 / 104])
    d, e = 4 * 0.5 / 104, 0.5 - 4 * 0.5 / 104
    assert p["I_g_33"] == pytest.approx(100 * 5 / 12 + 4 * 2 / 12 + 100 * d**2 + 4 * e**2)


def test_a_file_that_only_defines_a_vehicle_is_read_as_if_called(tmp_path: Path) -> None:
    (tmp_path / "parts.xacro").write_text(PARTS)
    text = CALLS.replace('<xacro:base ns="$(arg ns)" heavy="true"/>', "")
    assert numbers(tmp_path / "mine.xacro", text)["m"] == 100


def test_no_element_of_xacro_remains_after_expansion() -> None:
    root = etree.fromstring(CALLS)
    root[1:2] = list(etree.fromstring(PARTS))  # in the place of the include
    expand(root, "a.xacro")
    assert not [e.tag for e in root.iter() if is_xacro(e, local(e))]


def test_a_file_that_is_one_include_is_refused_in_words(tmp_path: Path) -> None:
    (tmp_path / "other.xacro").write_text('<robot name="r"/>')
    file = tmp_path / "a.xacro"
    file.write_text(
        '<xacro:include xmlns:xacro="http://www.ros.org/wiki/xacro" filename="other.xacro"/>'
    )
    with pytest.raises(InputInvalid, match=r"a.xacro:1: <include>; expected <robot>"):
        import_description(file)


def test_a_macro_that_calls_itself_is_refused_with_its_line(tmp_path: Path) -> None:
    loop = '<xacro:macro name="a" params=""><xacro:a/></xacro:macro>\n<xacro:a/>'
    head = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'
    (tmp_path / "a.xacro").write_text(f"{head}{loop}</robot>")
    with pytest.raises(InputInvalid, match=r"a.xacro:1: <xacro:a>: macros call each other"):
        import_description(tmp_path / "a.xacro")


def with_mesh(folder: Path, *, inside_out: bool = False, scale: str = "0.001") -> str:
    """Write a tetrahedron of 300 mm beside a.urdf; return the text of a.urdf."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]) * 300.0  # mm
    faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    faces = [f[::-1] for f in faces] if inside_out else faces
    facets = "".join(
        "facet normal 0 0 0\nouter loop\n"
        + "".join("vertex {} {} {}\n".format(*corners[i]) for i in face)
        + "endloop\nendfacet\n"
        for face in faces
    )
    (folder / "meshes").mkdir()
    (folder / "meshes/hull.stl").write_text(f"solid h\n{facets}endsolid h\n")
    mesh = f'<mesh filename="package://tiny/meshes/hull.stl" scale="{scale} 0.001 0.001"/>'
    text = URDF.format(more="").replace('<box size="1.0 0.5 0.2"/>', mesh)
    return text.replace('xyz="0.1 0.02 -0.03"', 'xyz="0.1 0.1 0.1"')


@pytest.mark.parametrize("scale", ["0.001", "-0.001"])
@pytest.mark.parametrize("inside_out", [False, True])
def test_a_mesh_that_is_inside_out_is_turned_and_reported(
    inside_out: bool, scale: str, tmp_path: Path
) -> None:
    """A scale with a minus mirrors the mesh, which turns no triangle inside out."""
    file = tmp_path / "a.urdf"
    file.write_text(with_mesh(tmp_path, inside_out=inside_out, scale=scale))
    found = import_description(file)
    assert found.draft.quantities["nabla"].value == pytest.approx(0.3**3 / 6)
    told = "<collision> mesh hull.stl: 4 of 4 triangles were inside out and are turned"
    assert any(told in note for note in found.notes) is inside_out
    assert (told in found.draft.readme) is inside_out


def test_a_mesh_that_lies_near_is_measured_and_one_that_does_not_is_said(tmp_path: Path) -> None:
    text = with_mesh(tmp_path)
    p = numbers(tmp_path / "a.urdf", text)
    assert p["nabla"] == pytest.approx(0.3**3 / 6)
    assert [p["x_b"], p["y_b"], p["z_b"], p["height"]] == pytest.approx(
        [0.075, -0.075, -0.075, 0.3]
    )
    (tmp_path / "a.urdf").write_text(text.replace("hull.stl", "other.stl"))
    notes = import_description(tmp_path / "a.urdf").notes
    assert any("other.stl: does not lie near a.urdf" in note for note in notes)
    assert any("assumed neutrally buoyant" in note for note in notes)


def test_all_mistakes_of_a_description_are_told_at_once(tmp_path: Path) -> None:
    water = WATER.replace("${volume}", "-1").replace("-4 -5 -6", "-4 -5").replace("4 0 0 0 6", "4")
    text = URDF.format(more=water).replace('mass value="100"', 'mass value="-9"')
    (tmp_path / "a.urdf").write_text(text.replace('iyy="20"', 'iyy="-20"'))
    with pytest.raises(InputInvalid) as caught:
        import_description(tmp_path / "a.urdf")
    told = str(caught.value)
    for what in ("-9 kg", "iyy = -20", "<volume>: -1 m3", "<added_mass>", "<quadratic_damping>"):
        assert what in told


def test_gz_sim_derivatives_lose_their_minus_and_are_turned(tmp_path: Path) -> None:
    p = numbers(tmp_path / "g.sdf", SDF)
    assert [p["M_A_11"], p["M_A_22"], p["D_l_11"], p["D_q_22"]] == [5, 126, 1, 600]
    # y and r both change sign: as it is, but for SNAME's minus; z and q likewise.
    assert [p["M_A_26"], p["M_A_35"], p["D_q_26"]] == [-7, -2, -12]
    assert p["nabla"] == pytest.approx(np.pi * 0.15**2 * 2.05)
    assert p["height"] == pytest.approx(0.3)
    assert p["z_g"] == pytest.approx(0.02)
    assert any("yRabsV" in note for note in import_description(tmp_path / "g.sdf").notes)
    write_draft(import_description(tmp_path / "g.sdf").draft, tmp_path / "glider")
    assert all(c.holds or c.known for c in checks_of(str(tmp_path / "glider")))


def test_an_odd_element_of_gz_sims_changes_its_sign_with_the_frame(tmp_path: Path) -> None:
    text = SDF.replace("<xU>-1</xU>", "<xU>-1</xU><xQ>-9</xQ><xP>-8</xP>")
    p = numbers(tmp_path / "g.sdf", text)
    assert [p["D_l_15"], p["D_l_14"]] == [-9, 8]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<robot", r"a.urdf:1: .*; expected XML"),
        ("<html></html>", r"a.urdf:1: <html>; expected <robot>"),
        ("<robot name='r'><link name='l'/></robot>", r"no link has an <inertial>"),
        (URDF.format(more="").replace('mass value="100"', 'mass value="a lot"'),
         r"a.urdf:4: <mass>: 'a lot'; expected 1 number"),
        (URDF.format(more="").replace('mass value="100"', 'mass value="${m}"'), r"expand it first"),
        (URDF.format(more=WATER.replace("fossen", "sphere")), r"<type>: 'sphere'; expected fossen"),
        (URDF.format(more=WATER.replace("${volume}", "0.1").replace("-4 -5 -6", "-4 -5")),
         r"<quadratic_damping>: .* expected 6 or 36 numbers"),
    ],
)  # fmt: skip
def test_a_file_that_holds_no_vehicle_is_refused_with_the_line(
    text: str, message: str, tmp_path: Path
) -> None:
    (tmp_path / "a.urdf").write_text(text)
    with pytest.raises(InputInvalid, match=message):
        import_description(tmp_path / "a.urdf")


def test_options_of_a_surface_are_refused_for_a_description(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.urdf").write_text(URDF.format(more=""))
    for option in (["--mass", "3"], ["--scale", "0.001"], ["--axes", "FRD"], ["--rho", "1000"]):
        assert status_of(["models", "import", str(tmp_path / "a.urdf"), *option]) == 2
        assert f"{option[0]}: applies to a surface" in capsys.readouterr().err
