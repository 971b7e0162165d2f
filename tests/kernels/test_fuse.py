"""A kernel is the master, many times at once: bit for bit, in every environment."""

from __future__ import annotations

import shutil
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.errors import ComponentFailed, InputInvalid, SystemInvalid
from uuvsim_cosim.kernels import Batch, Kernel, fuse
from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.orchestrator.plan.seeds import component_seeds
from uuvsim_cosim.orchestrator.running.library import available

STEPS = 2000  # 20 s
N_ENVS = 9
SEEDS = [11 + 7 * e for e in range(N_ENVS)]
SET_AT = 700  # of an environment's own ticks: the speed changes


def start() -> dict[str, Any]:
    """Parameters and start values, different in every environment."""
    e = np.arange(N_ENVS)
    eta_0 = np.zeros((N_ENVS, 6))
    eta_0[:, 1], eta_0[:, 2], eta_0[:, 5] = 0.1 * e, 1 + 0.05 * e, 0.02 * e
    return {"hull.eta_0": eta_0, "hull.m": 13.4 + 0.02 * e, "guidance.speed": 0.3 + 0.03 * e}


def of_one(e: int) -> dict[str, dict[str, Any]]:
    """The same for the master of environment e."""
    found: dict[str, dict[str, Any]] = {}
    for name, values in start().items():
        path, _, own = name.rpartition(".")
        found.setdefault(path, {})[own] = values[e]
    return found


def outputs_of(plan: Plan) -> list[str]:
    return [f"{c.path}.{v.name}" for c in plan.components for v in c.description.of("output")]


def seen(batch: Batch, names: list[str]) -> np.ndarray:
    return np.hstack([batch.get(n).reshape(batch.n_envs, -1).astype(float) for n in names])


@cache
def master_outputs(name: str) -> np.ndarray:
    """Every output of every component at every communication point, by environment."""
    plan = flatten(uuv.load(name))
    instantiate = prepare(plan, "native")
    rows = []
    for e in range(N_ENVS):
        with Master(plan, instantiate) as master:
            master.initialize()
            master.reset(seed=SEEDS[e], start=of_one(e))
            blocks = [
                c._block[c.description.of("output")[0].value_references[0] :]  # type: ignore[attr-defined]
                for c in master.components
            ]
            mine = [np.concatenate(blocks)]
            for k in range(STEPS):
                if k == SET_AT:
                    master.set("guidance", "speed", 0.25)
                master.step()
                mine.append(np.concatenate(blocks))
        rows.append(np.array(mine))
    return np.array(rows)


def with_compiler(monkeypatch: pytest.MonkeyPatch, compiler: str) -> None:
    if compiler == "zig":
        monkeypatch.delenv("CC", raising=False)
    elif shutil.which(compiler) is None:
        pytest.skip(f"no {compiler} here; zig is what users have")
    else:
        monkeypatch.setenv("CC", compiler)


@pytest.mark.parametrize(
    ("name", "lanes", "baseline", "compiler"),
    [
        ("bluerov2_hold", 1, True, "zig"),
        ("bluerov2_hold", 8, False, "zig"),
        ("bluerov2_hold", 8, True, "zig"),
        ("bluerov2_hold", 8, False, "gcc"),
        ("bluerov2_survey", 1, False, "zig"),
        ("bluerov2_survey", 8, False, "zig"),
        ("bluerov2_survey", 1, True, "gcc"),
        ("bluerov2_survey", 8, False, "gcc"),
    ],
)
def test_every_environment_has_the_bits_of_a_master_of_its_own(
    name: str, lanes: int, baseline: bool, compiler: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    wanted = master_outputs(name)
    with_compiler(monkeypatch, compiler)
    kernel = fuse(uuv.load(name), lanes=lanes, baseline=baseline)
    names = outputs_of(kernel.fused.plan)
    with kernel.batch(N_ENVS, seeds=SEEDS, start=start(), threads=2) as batch:
        for k in range(STEPS + 1):
            if k == SET_AT:
                batch.set("guidance.speed", 0.25)
            np.testing.assert_array_equal(seen(batch, names), wanted[:, k])
            batch.step()


@pytest.mark.parametrize("name", sorted({*available()} - {"bluerov2_ardusub", "bluerov2_px4"}))
def test_each_shipped_system_has_the_bits_of_its_master(name: str) -> None:
    kernel = fuse(uuv.load(name))
    plan = flatten(uuv.load(name), seed=3)
    paths = [(c.path, v) for c in plan.components for v in c.description.of("output")]
    with (
        Master(plan, prepare(plan, "native")) as master,
        kernel.batch(2, seeds=[5, 3]) as batch,
    ):
        master.initialize()
        for k in range(101):
            for path, variable in paths:
                seen_here = batch.get(f"{path}.{variable.name}")[1]
                wanted = np.asarray(master.get(path, variable.name)).reshape(seen_here.shape)
                np.testing.assert_array_equal(seen_here, wanted, f"{path}.{variable.name}, {k}")
            master.step()
            batch.step()


@pytest.mark.parametrize("name", ["bluerov2_hold", "bluerov2_survey"])
def test_environments_reset_at_different_times_repeat_their_masters(name: str) -> None:
    wanted = master_outputs(name)
    kernel = fuse(uuv.load(name))
    names = outputs_of(kernel.fused.plan)
    batch = kernel.batch(N_ENVS, seeds=SEEDS, start=start())
    each = np.arange(N_ENVS)
    for k in range(800):
        due = (k % (37 * (each + 1)) == 0) & (k < 600)
        if k and due.any():
            batch.reset(due)
            assert (batch.tick[due] == 0).all()
        np.testing.assert_array_equal(seen(batch, names), wanted[each, batch.tick])
        later = batch.tick == SET_AT
        if later.any():
            batch.set("guidance.speed", 0.25, later)
        batch.step()
    assert len(set(batch.time)) > 4


@pytest.fixture(scope="module")
def hold() -> Kernel:
    return fuse(uuv.load("bluerov2_hold"))


def test_many_steps_in_one_call_are_single_steps(hold: Kernel) -> None:
    one, many = hold.batch(3), hold.batch(3, threads=2)
    for _ in range(50):
        one.step()
    many.step(50)
    np.testing.assert_array_equal(one.get("hull.eta"), many.get("hull.eta"))
    np.testing.assert_array_equal(many.time, [0.5] * 3)


def test_equal_components_are_compiled_once(hold: Kernel) -> None:
    assert len(hold.fused.members) == 13
    assert len(hold.fused.sources) == 6


def test_a_connection_with_a_factor_and_an_offset_is_converted_as_the_master_does_it() -> None:
    system = uuv.System("scaled", "0.01")
    system = system.add("battery", "model:battery").add("lag", "model:thruster_t200")
    system = system.connect("battery.voltage", "lag.voltage", factor=0.7, offset=2.1)
    system = system.connect("lag.current", "battery.current", factor=1.3, offset=0.7)
    system = system.replace("lag", "model:thruster_t200", start={"u": 0.6})
    plan = flatten(system)
    batch = fuse(system).batch(2)
    names = outputs_of(plan)
    with Master(plan, prepare(plan, "native")) as master:
        master.initialize()
        for _ in range(100):
            batch.step()
            master.step()
            mine = [np.ravel(master.get(*n.rsplit(".", 1))) for n in names]
            np.testing.assert_array_equal(seen(batch, names)[1], np.concatenate(mine))


def test_a_python_component_is_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "law.py").write_text(
        'ETA = (6, ("m", "m", "m", "rad", "rad", "rad"))\n'
        'NU = (6, ("m/s", "m/s", "m/s", "rad/s", "rad/s", "rad/s"))\n\n\n'
        "class Law:\n"
        '    inputs = {"eta_d": ETA, "nu_d": NU, "eta": ETA, "nu": NU}\n'
        '    outputs = {"tau_d": (6, ("N", "N", "N", "N.m", "N.m", "N.m"))}\n\n'
        "    def step(self, t, dt, u):\n"
        '        return {"tau_d": [0, 0, 0, 0, 0, 0]}\n'
    )
    system = uuv.load("bluerov2_hold").replace("controller", f"{tmp_path / 'law.py'}:Law")
    with pytest.raises(SystemInvalid, match=r"controller: a Python component.*in a kernel"):
        fuse(system)


def test_clocks_off_the_tick_or_off_a_longer_step_are_refused_by_name() -> None:
    odd = uuv.System("odd", "0.03").add("compass", "model:compass")
    with pytest.raises(SystemInvalid, match=r"compass: clock .* period of 1/10 s"):
        fuse(odd)
    across = uuv.load("bluerov2_survey").replace("controller", "model:controller", rate="0.03")
    with pytest.raises(SystemInvalid, match=r"controller: clock .* its communication step, 3/100"):
        fuse(across)


def test_wrong_lanes_seeds_names_and_values_are_refused(hold: Kernel) -> None:
    batch = hold.batch(3)
    with pytest.raises(InputInvalid, match="lanes: 3; expected one of 1, 2, 4"):
        fuse(uuv.load("bluerov2_hold"), lanes=3)
    with pytest.raises(InputInvalid, match="dtype: 'float16'; expected one of float64, float32"):
        fuse(uuv.load("bluerov2_hold"), dtype="float16")
    with pytest.raises(InputInvalid, match="-1 steps"):
        batch.step(-1)
    with pytest.raises(InputInvalid, match="environment 3; expected one of 0 to 2"):
        batch.failure(3)
    with pytest.raises(
        InputInvalid, match=r"no variable 'hull\.etta'; expected one such as hull\.eta"
    ):
        batch.get("hull.etta")
    with pytest.raises(InputInvalid, match=r"hull\.tau: is connected"):
        batch.set("hull.tau", np.zeros(6))
    with pytest.raises(InputInvalid, match=r"hull\.m: value nan"):
        batch.set("hull.m", [13.0, np.nan, 13.0])
    with pytest.raises(InputInvalid, match=r"hull\.m: values of shape \(2,\)"):
        batch.set("hull.m", [13.0, 13.0])
    with pytest.raises(InputInvalid, match=r"seeds: 1\.5"):
        hold.batch(3, seeds=1.5)  # type: ignore[arg-type]
    with pytest.raises(InputInvalid, match="seeds: 2; expected one, or 3"):
        hold.batch(3, seeds=[1, 2])
    with pytest.raises(InputInvalid, match="mask: int64"):
        batch.reset(np.array([0, 1, 0]))


def test_a_value_that_is_not_finite_names_component_time_and_environment(hold: Kernel) -> None:
    batch, whole = hold.batch(3), hold.batch(3)
    batch.step(5)
    whole.step(10)
    batch.set("hull.v_c", [[0.0] * 3, [1e200] * 3, [0.0] * 3])
    with pytest.raises(ComponentFailed, match=r"'hull' failed at t = 0\.0[5-7] s.*environment 1"):
        batch.step(5)
    np.testing.assert_array_equal(batch.failed, [False, True, False])
    ends = batch.get("hull.eta")[[0, 2]], whole.get("hull.eta")[[0, 2]]
    np.testing.assert_array_equal(*ends)
    batch.reset(batch.failed)
    batch.step(10)
    np.testing.assert_array_equal(batch.get("hull.eta")[1], whole.get("hull.eta")[1])


def test_without_check_a_failure_is_kept_and_not_raised(hold: Kernel) -> None:
    batch = hold.batch(3)
    batch.set("hull.v_c", [[0.0] * 3, [1e200] * 3, [0.0] * 3])
    batch.step(5, check=False)
    assert batch.failed.tolist() == [False, True, False]
    assert batch.failure(0) is None
    failure = batch.failure(1)
    assert isinstance(failure, ComponentFailed)
    assert "environment 1" in str(failure)
    with pytest.raises(ComponentFailed):
        batch.step()
    batch.reset(batch.failed, start={"hull.nu_0": [[1e300] * 6] * 3}, check=False)
    assert batch.failed.tolist() == [False, True, False]


def test_variables_are_known_by_their_full_names(hold: Kernel) -> None:
    batch = hold.batch(2)
    assert batch.variables["hull.eta"].shape == (6,)
    for name, v in batch.variables.items():
        assert batch.get(name).shape == (2, *v.shape)


def test_seeds_are_those_of_the_master() -> None:
    system = uuv.load("bluerov2_survey")
    seeds = [0, 3, 2**63 + 5, 2**64 - 1, 7]
    batch = fuse(system).batch(len(seeds), seeds=seeds)
    mask = np.array([False, True, False, True, False])
    batch.reset(mask, seeds=[1, 2, 3, 4, 5])
    for path in ("imu", "dvl"):
        wanted = component_seeds([0, 2, 2**63 + 5, 4, 7], [path])[:, 0]
        np.testing.assert_array_equal(batch.get(f"{path}.seed"), wanted)
        single = fuse(system, dtype="float32").batch(len(seeds), seeds=seeds)
        single.reset(mask, seeds=[1, 2, 3, 4, 5])
        np.testing.assert_array_equal(single.get(f"{path}.seed"), wanted)
    for seed in (-1, 2**64):
        with pytest.raises(
            InputInvalid, match=rf"seed {seed}: expected an integer of 0 … 2\^64 - 1"
        ):
            batch.reset(seeds=[0, 1, 2, 3, seed])
