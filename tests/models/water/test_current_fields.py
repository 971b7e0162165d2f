"""Currents that change with place, depth and time: laws, files, and what is no such file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import netcdf_file

from uuvsim_cosim.errors import ComponentFailed, InputInvalid, UuvsimError
from uuvsim_cosim.fmus.codegen.native import Native
from uuvsim_cosim.kernels.kernel import fuse
from uuvsim_cosim.models.analysis.simulate import simulate
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.intrinsics.field import Field, field
from uuvsim_cosim.models.intrinsics.network import NETWORKS
from uuvsim_cosim.models.water.current import current_grid, current_profile
from uuvsim_cosim.orchestrator.running.run import run
from uuvsim_cosim.orchestrator.system.system import System

AXES = {
    "time": ("s", np.array([0.0, 100.0, 300.0])),
    "depth": ("m", np.array([0.0, 5.0, 20.0])),
    "y": ("m", np.linspace(-50, 50, 5)),
    "x": ("m", np.linspace(-30, 30, 4)),
}


def linear(t: Any, d: Any, n: Any, e: Any) -> tuple[Any, Any]:
    """A current to the east and to the north that interpolation gives exactly."""
    return 0.1 + 1e-3 * t - 0.01 * d + 2e-3 * n, 0.2 - 5e-4 * t + 4e-3 * e + 1e-3 * n


def write(file: Path, *, axes: Any = None, order: Any = None, **changes: Any) -> str:
    """Write a file of `linear`, with changes: u, v (arrays), units of u, names of variables."""
    axes = {**AXES, **(axes or {})}
    order = list(order or axes)
    f = netcdf_file(str(file), "w")
    for name in order:
        unit, values = axes[name]
        f.createDimension(name, len(values))
        kept = f.createVariable(name, "f8", (name,))
        kept[:] = values
        if unit:
            kept.units = unit
    grids = np.meshgrid(*(AXES[a][1] for a in AXES), indexing="ij")
    for name, values in zip("uv", linear(*grids), strict=True):
        values = changes.get(name, values).transpose([list(AXES).index(a) for a in order])
        kept = f.createVariable(changes.get(f"{name}_name", name), "f8", tuple(order))
        kept[:] = values / changes.get("factor", 1.0)
        if changes.get("units", "m/s"):
            kept.units = changes.get("units", "m/s")
    f.close()
    return str(file)


def flow(model: Model, t: float, d: float, n: float, e: float) -> np.ndarray:
    r = simulate(model, at=[0.0], inputs={"eta": [n, e, d, 0, 0, 0]}, parameters={"t_0": t})
    return np.asarray(r["v_c"][0])


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> str:
    return write(tmp_path_factory.mktemp("currents") / "linear.nc")


@settings(max_examples=30, deadline=None)
@given(st.floats(0, 300), st.floats(0, 20), st.floats(-50, 50), st.floats(-30, 30))
def test_a_linear_current_is_given_exactly_between_the_nodes(
    file: str, t: float, d: float, n: float, e: float
) -> None:
    east, north = linear(t, d, n, e)
    np.testing.assert_allclose(flow(current_grid(file), t, d, n, e), [north, east, 0], atol=1e-7)


def test_beyond_the_levels_the_nearest_holds_and_beside_the_grid_there_is_none(file: str) -> None:
    m = current_grid(file)
    np.testing.assert_array_equal(flow(m, 0, 99, 0, 0), flow(m, 0, 20, 0, 0))
    np.testing.assert_array_equal(flow(m, 0, -1, 0, 0), flow(m, 0, 0, 0, 0))
    for t, n in ((0, 51), (301, 0)):
        with pytest.raises(ComponentFailed, match="not finite"):
            flow(m, t, 5, n, 0)


def test_the_gradient_is_that_between_the_nodes() -> None:
    axes = [np.linspace(0, 10, n) for n in (3, 4, 2, 5)]
    nodes = np.random.default_rng(0).normal(size=(3, 4, 2, 5, 2))
    at = ca.SX.sym("at", 4)
    J = ca.Function("J", [at], [ca.jacobian(field(axes, nodes, (True,) * 4)(at), at)])
    f = next(n for n in reversed(NETWORKS.values()) if isinstance(n, Field))
    for x in np.random.default_rng(1).uniform(0.1, 9.9, (10, 4)):
        steps = 1e-4 * np.eye(4)
        wanted = np.column_stack([(f(x + h) - f(x - h)) / 2e-4 for h in steps])
        np.testing.assert_allclose(np.array(J(x)), wanted, atol=1e-9)


@pytest.mark.parametrize(
    ("units", "factor"),
    [("cm/s", 0.01), ("knots", 1852 / 3600), ("ft/s", 0.3048), ("m s-1", 1.0), ("km/h", 1 / 3.6)],
)
def test_units_of_speed_are_converted(tmp_path: Path, units: str, factor: float) -> None:
    m = current_grid(write(tmp_path / "a.nc", units=units, factor=factor))
    np.testing.assert_allclose(flow(m, 0, 0, 0, 0), [0.2, 0.1, 0], atol=1e-6)


def test_axes_may_lie_in_any_order_and_direction_and_unit(tmp_path: Path, file: str) -> None:
    """Depth in feet, upwards and from below; the file's order x, y, time, depth."""
    depth = ("feet", AXES["depth"][1] / 0.3048)
    turned = write(tmp_path / "a.nc", axes={"depth": depth}, order=["x", "y", "time", "depth"])
    at = (50.0, 7.0, 12.0, -8.0)
    np.testing.assert_allclose(flow(current_grid(turned), *at), flow(current_grid(file), *at),
                               atol=1e-7)  # fmt: skip


def test_degrees_become_metres_of_the_ellipsoid(tmp_path: Path) -> None:
    """At 47 N a minute of latitude is 1852.8 m, of longitude 1267.4 m (WGS 84)."""
    path = tmp_path / "a.nc"
    f = netcdf_file(str(path), "w")
    for name, values, unit in (
        ("lat", [47.0, 47 + 1 / 60], "degrees_north"),
        ("lon", [237.0, 237 + 1 / 60], "degrees_east"),
    ):
        f.createDimension(name, 2)
        f.createVariable(name, "f8", (name,))[:] = values
        f.variables[name].units = unit
    for name, value in (("u", [[0, 1], [0, 1]]), ("v", [[0, 0], [1, 1]])):
        f.createVariable(name, "f4", ("lat", "lon"))[:] = value
        f.variables[name].units = "m/s"
    f.close()
    m = current_grid(str(path), latitude=47.0, longitude=-123.0)
    r = simulate(m, at=[0.0], inputs={"eta": [926.4, 633.7, 3, 0, 0, 0]})
    np.testing.assert_allclose(r["v_c"][0], [0.5, 0.5, 0], atol=2e-4)


def test_native_kernel_and_casadi_agree_to_the_bit_and_the_run_ends_with_the_files_name(
    file: str, tmp_path: Path
) -> None:
    source = f"model:current_grid?file={file}"
    system = System("water", "1").add("current", source)
    places = np.array([[12.3, -4.5, 3.3, 0, 0, 0], [-49.9, 29.9, 17.0, 0, 0, 0]])
    c = Native(current_grid(file), "current")
    v = c.description.variables
    with fuse(system).batch(2, start={"current.eta": places}) as batch:
        batch.step(20)
        lanes = batch.get("current.v_c")
    with fuse(system, dtype="float32").batch(2, start={"current.eta": places}) as batch:
        batch.step(20)
        np.testing.assert_allclose(batch.get("current.v_c"), lanes, atol=1e-6)
    for i, eta in enumerate(places):
        one = c.another("current")
        one.enter_initialization_mode(0.0, None)
        one.set(v["eta"], eta)
        one.exit_initialization_mode()
        for k in range(20):
            one.do_step(k, 1.0)
        wanted = simulate(current_grid(file), at=[20.0], inputs={"eta": eta})["v_c"][0]
        np.testing.assert_array_equal(one.get(v["v_c"]), wanted)
        np.testing.assert_array_equal(lanes[i], wanted)
    late = system.set("current.t_0", 299.0)
    with pytest.raises(
        ComponentFailed, match=r"current.*NaN outside of linear\.nc, which has 0 to 300 s"
    ):
        run(late, until=5.0, out=tmp_path, backend="native")


def test_a_run_that_begins_or_goes_beside_the_grid_names_the_file_as_fmu_and_native(
    file: str, tmp_path: Path
) -> None:
    system = System("water", "1").add("current", f"model:current_grid?file={file}")
    system = system.add("hull", "model:sphere").connect("current.v_c", "hull.v_c")
    system = system.connect("hull.eta", "current.eta")
    beside = system.set("hull.eta_0", [60.0, 0, 2, 0, 0, 0])
    late = system.set("current.t_0", 299.0)
    names = r"NaN outside of linear\.nc, which has 0 to 300 s, N -50 to 50 m, E -30 to 30 m"
    for backend in ("fmu", "native"):
        with pytest.raises(UuvsimError, match=rf"hull.*v_c.*current\.v_c gives it \(.*{names}"):
            run(beside, until=1.0, out=tmp_path / f"{backend}_beside", backend=backend)
        with pytest.raises(ComponentFailed, match=rf"'current' failed at t = .*{names}"):
            run(late, until=5.0, out=tmp_path / f"{backend}_late", backend=backend)


WRONG: dict[str, tuple[dict[str, Any], dict[str, Any], str]] = {
    "furlongs": ({"units": "furlong/h"}, {}, "u has unit 'furlong/h'; expected a speed such as"),
    "no unit": ({"units": ""}, {}, r"u has no unit; expected .* or unit=UNIT"),
    "no u": ({"u_name": "salinity"}, {}, r"no variable for the current to the east .* u=NAME"),
    "wrong name": ({}, {"u": "vv"}, "no variable 'vv'"),
    "axis twice": ({"axes": {"y": ("m", np.array([0.0, 0, 1, 2, 3]))}}, {}, "north has a value"),
    "NaN axis": ({"axes": {"y": ("m", np.array([np.nan, 0, 1, 2, 3]))}}, {}, "axis north has miss"),
    "no unit of axis": ({"axes": {"x": ("", AXES["x"][1])}}, {}, "x has no unit; expected m"),
    "degrees and metres": ({"axes": {"x": ("degrees_east", AXES["x"][1])}}, {}, "both in degrees"),
    "unknown axis": ({"axes": {"time": ("furlong", AXES["time"][1])}}, {}, "time has unit 'furl"),
    "start after the end": ({}, {"start": "301"}, "start=301 is 301 s after its first time"),
    "start is a date": ({}, {"start": "2020-05-01"}, "its time has no date"),
    "far away": (
        {}, {"northing": 9e5, "easting": 0, "extent": 10}, "nothing lies within 10 m of the",
    ),
    "half an origin": ({}, {"latitude": 47}, "latitude=47, longitude=''; expected both"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_a_file_that_is_none_of_a_current_is_refused_by_name(name: str, tmp_path: Path) -> None:
    changes, options, words = WRONG[name]
    path = write(tmp_path / "wrong.nc", **changes)
    with pytest.raises(InputInvalid, match=words) as error:
        current_grid(path, **options)
    assert "wrong.nc" in str(error.value) or name == "half an origin"


def test_holes_are_refused_or_filled_with_the_nearest(tmp_path: Path) -> None:
    grids = np.meshgrid(*(AXES[a][1] for a in AXES), indexing="ij")
    u = linear(*grids)[0]
    u[:, :, 0, 0] = np.nan
    path = write(tmp_path / "holes.nc", u=u)
    with pytest.raises(InputInvalid, match=r"u has no value at 9 of 180 nodes .* holes=nearest"):
        current_grid(path)
    dry = linear(*grids)[0]
    dry[1, 0] = np.nan
    with pytest.raises(InputInvalid, match=r"dry\.nc: u has no value at all at its time 1"):
        current_grid(write(tmp_path / "dry.nc", u=dry), holes="nearest")
    at = flow(current_grid(path, holes="nearest"), 0, 0, -50, -30)
    assert at[1] == pytest.approx(linear(0, 0, -50, -10)[0], abs=1e-6)


def test_what_is_no_netcdf_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.nc").write_text("depth,north,east")
    with pytest.raises(InputInvalid, match=r"a\.nc: no netCDF file"):
        current_grid(str(tmp_path / "a.nc"))
    with pytest.raises(InputInvalid, match=r"b\.nc: cannot be read"):
        current_grid(str(tmp_path / "b.nc"))
    (tmp_path / "c.nc").write_bytes(b"CDF\x01" + b"\xff" * 40)
    with pytest.raises(InputInvalid, match=r"c\.nc: a netCDF file that cannot be read"):
        current_grid(str(tmp_path / "c.nc"))


# ---- sheared with depth ------------------------------------------------------------------------


def profile(d: list[float], parameters: dict[str, Any], **options: Any) -> np.ndarray:
    m = current_profile(**options)
    rows = [
        simulate(m, at=[0.0], inputs={"eta": [0, 0, x, 0, 0, 0]}, parameters=parameters)["v_c"][0]
        for x in d
    ]
    return np.array(rows)


def test_the_power_law_is_dnvs() -> None:
    v = profile([0, 10, 40, 50, 60, -1], {"speed": 0.8, "direction": 0.0, "h": 50.0})
    expected = 0.8 * np.array([1, 0.8 ** (1 / 7), 0.2 ** (1 / 7), 0, 0, 1])
    np.testing.assert_allclose(v[:, 0], expected, atol=1e-14)


def test_a_logarithmic_layer_has_the_same_friction_velocity_at_all_heights() -> None:
    """Z dV/dz = u_* / kappa is constant."""
    z = np.array([0.1, 1.0, 10.0])
    step = 1e-4
    above, below = (
        profile(list(30.0 - z * (1 + s)), {"h": 30.0, "z_0": 0.002}, law="log")[:, 0]
        for s in (step, -step)
    )
    slope = (above - below) / (2 * step)
    np.testing.assert_allclose(slope, 0.5 / np.log(30 / 0.002), rtol=1e-7)
    assert profile([30.0], {"h": 30.0}, law="log")[0, 0] == 0.0


def test_a_table_is_linear_between_its_levels(tmp_path: Path) -> None:
    file = tmp_path / "p.csv"
    file.write_text("depth,north,east\n5,0.2,0\n15,0,0.4\n30,0.1,0.1\n")
    v = profile([0, 5, 10, 15, 99], {}, law="table", file=str(file))
    np.testing.assert_allclose(v[:, 0], [0.2, 0.2, 0.1, 0, 0.1], atol=1e-15)
    np.testing.assert_allclose(v[:, 1], [0, 0, 0.2, 0.4, 0.1], atol=1e-15)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("depth [ft],north,east\n", "expected 'depth,north,east'"),
        ("depth,north,east\n1,2,3\n0,1,2\n", "depths rising"),
        ("depth,north,east\n1,2,nan\n", "line 2: .* three numbers"),
        ("", "expected 'depth,north,east'"),
    ],
)
def test_a_profile_that_is_none_is_refused(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "p.csv").write_text(text)
    with pytest.raises(InputInvalid, match=rf"p\.csv: .*{words}"):
        current_profile("table", str(tmp_path / "p.csv"))


def test_a_replaced_current_is_told_where_the_hull_is() -> None:
    from uuvsim_cosim.orchestrator.running.library import load

    for source in ("current_grid", "current_profile", "waves"):
        swapped = load("bluerov2_survey").replace("current", source)
        assert ("hull.eta", "current.eta") in {(c.source, c.target) for c in swapped.connections}


# ---- netCDF-4, as ocean models write it --------------------------------------------------------


def ocean(path: Path, *, two_axes: bool = False, staggered: bool = False) -> str:
    """Write packed integers with a mask, hours since a date, heights below the surface."""
    import netCDF4

    with netCDF4.Dataset(str(path), "w") as f:
        sizes = {"ocean_time": 3, "depth": 2, "lat": 6, "lon": 8, "lon_v": 8}
        for name, n in sizes.items():
            f.createDimension(name, n)
        axes = {
            "ocean_time": ("hours since 2024-03-01 00:00:00", np.arange(3.0) + 5),
            "depth": ("m", [-10.0, 0.0]),
            "lat": ("degrees_north", 60 + 0.01 * np.arange(6)[::-1]),
            "lon": ("degrees_east", 5 + 0.01 * np.arange(8)),
            "lon_v": ("degrees_east", 5.005 + 0.01 * np.arange(8)),
        }
        for name, (unit, values) in axes.items():
            two = two_axes and name == "lat"
            kept = f.createVariable(name, "f8", ("lat", "lon") if two else (name,))
            kept.units = unit
            kept[:] = np.tile(np.asarray(values)[:, None], 8) if two else values
        f["depth"].positive = "up"
        f["lon_v"].axis = "X"
        for name, standard in (("a", "eastward"), ("b", "northward")):
            last = "lon_v" if staggered and name == "b" else "lon"
            kept = f.createVariable(
                name, "i2", ("ocean_time", "depth", "lat", last), fill_value=-32767, zlib=True
            )
            kept.setncatts({"scale_factor": 0.01, "units": "cm s-1",
                            "standard_name": f"{standard}_sea_water_velocity"})  # fmt: skip
            value = np.full((3, 2, 6, 8), 20.0 if name == "a" else -5.0)
            value[:, 1] *= 2.0  # at the surface
            value[:, :, 0, 0] = -327.67  # the north-western corner is land
            kept[:] = np.ma.masked_less(value, -300)
    return str(path)


def test_an_ocean_models_file_is_read_within_an_extent_from_a_date_on(tmp_path: Path) -> None:
    file = ocean(tmp_path / "ocean.nc")
    here = {"latitude": 60.02, "longitude": 5.04}
    m = current_grid(file, **here, extent=1500, start="2024-03-01T06:30")
    r = simulate(m, at=[0.0], inputs={"eta": [10.0, -20.0, 5.0, 0, 0, 0]})
    np.testing.assert_allclose(r["v_c"][0], [-0.075, 0.3, 0.0], atol=1e-7)
    assert m.variables["t_0"].start == 5400.0
    with pytest.raises(InputInvalid, match=r"ocean\.nc: a has no value at 6 of 288 nodes"):
        current_grid(file, **here)
    with pytest.raises(InputInvalid, match="expected 0 to 7200 s"):
        current_grid(file, **here, extent=1500, start="2024-03-02")


def test_curvilinear_and_staggered_grids_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputInvalid, match=r"o\.nc: lat has axes .* a regular grid"):
        current_grid(ocean(tmp_path / "o.nc", two_axes=True))
    with pytest.raises(InputInvalid, match=r"s\.nc: a has axes .*expected the same \(a staggered"):
        current_grid(ocean(tmp_path / "s.nc", staggered=True))
