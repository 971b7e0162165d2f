"""A policy that leaves acts as torch does, wherever it goes."""

import ast
import importlib.util
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
import pytest
import torch

from uuvsim_cosim.cli import status_of
from uuvsim_cosim.content import content
from uuvsim_cosim.envs.episodes.spaces import ActionBox
from uuvsim_cosim.envs.task.task import Task
from uuvsim_cosim.envs.tasks.evaluation import evaluate
from uuvsim_cosim.envs.tasks.target_tracking import TargetTracking
from uuvsim_cosim.envs.tasks.tracking_scenarios import SCENARIOS
from uuvsim_cosim.errors import InputInvalid, SystemInvalid
from uuvsim_cosim.fmus.codegen.native import Native
from uuvsim_cosim.learn.deployment.export import export_policy, policy_model
from uuvsim_cosim.learn.policies.policy import Named, Policy
from uuvsim_cosim.learn.shared.task_ids import make_task
from uuvsim_cosim.learn.training.agents import widths
from uuvsim_cosim.learn.training.rollout import Rollout
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.running.library import load
from uuvsim_cosim.orchestrator.system.resolve import resolve
from uuvsim_cosim.orchestrator.system.sources import FmuSource
from uuvsim_cosim.orchestrator.system.system import System

SHIPPED = content("models", "policies") / "source_sac.npz"


def drawn(
    observed: int,
    acted: int,
    kind: str = "tanh",
    activation: str = "relu",
    task: str = "uuvsim/StationKeeping-v0",
    **more: Any,
) -> Policy:
    r = np.random.default_rng(4)
    wide = 7 if kind == "grid" else acted
    tensors = {
        f"{i}.{what}": (r.normal(size=shape) / np.sqrt(shape[-1])).astype(np.float32)
        for i, (a, b) in enumerate([(observed, 24), (24, wide)])
        for what, shape in (("weight", (b, a)), ("bias", (b,)))
    }
    if kind == "grid":
        tensors["grid"] = r.uniform(-1, 1, (wide, acted)).astype(np.float32)
    if kind == "clip":
        tensors |= {
            "shift": r.normal(size=observed).astype(np.float32),
            "scale": r.uniform(0.5, 2, observed).astype(np.float32),
        }
    return Policy(
        kind=kind,  # type: ignore[arg-type]
        tensors=tensors,
        observation=tuple(Named(f"o[{i}]", -4.0, 4.0) for i in range(observed)),
        action=tuple(Named(f"a[{i}]", -1.0, 1.0) for i in range(acted)),
        task=task,
        activation=activation,  # type: ignore[arg-type]
        **more,
    )


def by_torch(policy: Policy, observation: np.ndarray) -> np.ndarray:
    """Act in torch, in float64: exact but for the weights."""
    t = {k: torch.from_numpy(np.asarray(v, np.float64)) for k, v in policy.tensors.items()}
    x = torch.from_numpy(np.asarray(observation, np.float32).astype(np.float64))
    if "shift" in t:
        x = (x - t["shift"]) * t["scale"]
    for i in range(policy.depth):
        x = torch.nn.functional.linear(x, t[f"{i}.weight"], t[f"{i}.bias"])
        if i + 1 < policy.depth:
            x = torch.relu(x) if policy.activation == "relu" else torch.tanh(x)
    if policy.kind == "grid":
        x = t["grid"][x.argmax(1)]
    return np.asarray(torch.tanh(x) if policy.kind == "tanh" else x.clamp(-1, 1))


def stepped(component: Any, observations: np.ndarray, step: float = 0.1) -> np.ndarray:
    v, rows = component.description.variables, []
    component.enter_initialization_mode(0.0, None)
    component.exit_initialization_mode()
    for k, row in enumerate(observations):
        component.set(v["observation"], np.asarray(row, float))
        component.do_step(k * step, step)
        rows.append(np.ravel(component.get(v["action"])))
    return np.array(rows)


@pytest.fixture(scope="module")
def shipped() -> Policy:
    return Policy.load(SHIPPED)


@pytest.fixture(scope="module")
def seen(shipped: Policy) -> np.ndarray:
    """What the policy observes in 8 episodes."""
    rollout, rows = Rollout(SCENARIOS["source"](**shipped.options), 8, 5), []
    for _ in range(50):
        rows.append(rollout.observation[:, 0].copy())
        rollout.step(shipped(rows[-1])[:, None].astype(np.float32))
    return np.concatenate(rows)


@pytest.fixture(scope="module")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return export_policy(SHIPPED, tmp_path_factory.mktemp("fmu") / "policy.fmu")[0]


KINDS = [("tanh", "relu"), ("clip", "tanh"), ("grid", "relu")]


@pytest.mark.parametrize(("kind", "activation"), KINDS)
def test_onnx_runner_and_component_act_as_torch_within_1e_6(
    kind: str, activation: str, tmp_path: Path
) -> None:
    policy = drawn(6, 3, kind, activation)
    observations = np.random.default_rng(1).uniform(-4, 4, (40, 6)).astype(np.float32)
    want = by_torch(policy, observations)
    file = policy.save(tmp_path / "p.npz")
    (onnx,) = export_policy(file, tmp_path / "p.onnx")
    session = onnxruntime.InferenceSession(str(onnx), providers=["CPUExecutionProvider"])
    (acted,) = session.run(None, {"observation": observations})
    assert np.allclose(acted, want, rtol=0, atol=1e-6)
    code, weights = export_policy(file, tmp_path / "r.py")
    runner = module_of(code).Runner()
    assert weights.is_file()
    assert np.allclose([runner.act(o) for o in observations], want, rtol=0, atol=1e-6)
    component = Native(policy_model(policy, plain=True), "p")
    assert np.allclose(stepped(component, observations), want, rtol=0, atol=1e-6)


def test_an_action_has_units_in_the_fmu_and_as_a_source_but_not_when_plain(
    tmp_path: Path,
) -> None:
    """The forces and moments of station keeping have limits, for which -1 and 1 stand."""
    observed, acted = widths(make_task("uuvsim/StationKeeping-v0"))
    policy = drawn(observed, acted, "clip")
    policy.tensors["1.bias"][:] = 100.0  # every action is 1
    file = policy.save(tmp_path / "p.npz")
    seen = np.zeros((2, observed))
    in_units = Native(policy_model(policy), "p")
    action = in_units.description.variables["action"]
    units = [action.unit_of_element(i) for i in range(acted)]
    assert units == ["N"] * 3 + ["N.m"] * 3
    task = make_task(policy.task)
    assert isinstance(task, Task)
    most = ActionBox(flatten(task.system), task.actions)
    assert stepped(in_units, seen)[-1] == pytest.approx(most.scaled(np.ones((1, acted)))[:, 0])
    plain_source = resolve(f"policy:{file}?plain=1", tmp_path)
    for component in (
        Native(policy_model(policy, plain=True), "p"),
        plain_source.instantiate("p", backend="native"),
    ):
        assert component.description.variables["action"].unit == "1"
        assert np.array_equal(stepped(component, seen)[-1], np.ones(acted))


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_source_has_the_bits_of_the_fmu_of_the_same_policy(fmi: int, tmp_path: Path) -> None:
    observed, acted = widths(make_task("uuvsim/StationKeeping-v0"))
    file = drawn(observed, acted, "tanh").save(tmp_path / "p.npz")
    component = resolve(f"policy:{file}", tmp_path).instantiate("p", backend="native")
    seen = np.random.default_rng(3).uniform(-1, 1, observed)
    want = stepped(component, np.tile(seen, (3, 1)))
    assert np.abs(want).max() > 1.5  # in N and N.m, not in [-1, 1]
    (fmu,) = export_policy(file, tmp_path / "p.fmu", fmi=fmi)
    foreign = FmuSource(fmu).instantiate("p")
    for mine in (component, resolve(f"policy:{file}", tmp_path).instantiate("q")):
        theirs = foreign.description.variables["action"]
        variable = mine.description.variables["action"]
        for i in range(acted):
            assert variable.unit_of_element(i) == theirs.unit_of_element(i)
    assert np.array_equal(stepped(foreign, np.tile(seen, (3, 1))), want)


def test_a_policy_whose_task_is_missing_is_refused_unless_it_is_plain(tmp_path: Path) -> None:
    file = drawn(6, 3, task="mine.py:Gone").save(tmp_path / "p.npz")
    for take in (
        lambda: resolve(f"policy:{file}", tmp_path),
        lambda: export_policy(file, tmp_path / "p.fmu"),
    ):
        with pytest.raises(InputInvalid, match=r"mine.py:Gone: its task.* not available.*--plain"):
            take()
    plain = resolve(f"policy:{file}?plain=1", tmp_path).describe()
    assert plain.variables["action"].shape == (3,)
    wide = drawn(6, 3).save(tmp_path / "wide.npz")
    with pytest.raises(InputInvalid, match=r"has 3 actions, and the task acts on 6 inputs"):
        resolve(f"policy:{wide}", tmp_path)


@pytest.mark.parametrize("text", ["1", "[[1]]", "x", '[["a", 0, 1, "N"]]', '[["a", "b", 1, "N"]]'])
def test_limits_of_actions_that_do_not_fit_are_refused(text: str, tmp_path: Path) -> None:
    file = drawn(6, 3).save(tmp_path / "p.npz")
    with pytest.raises(InputInvalid, match=r"expected \[name, low, high, unit\] for each of the 3"):
        declare("policy", file=str(file), action=text)


def test_the_trained_policy_acts_as_torch_within_1e_6(
    shipped: Policy, seen: np.ndarray, tmp_path: Path
) -> None:
    (pth,) = export_policy(SHIPPED, tmp_path / "p.pth")
    linear, relu = torch.nn.Linear, torch.nn.ReLU
    net = torch.nn.Sequential(
        linear(31, 256), relu(), linear(256, 256), relu(), linear(256, 2), torch.nn.Tanh()
    )
    net[:-1].load_state_dict(torch.load(pth, weights_only=True))
    torch.set_num_threads(1)
    with torch.inference_mode():
        single = net(torch.from_numpy(seen)).numpy()
    (onnx,) = export_policy(SHIPPED, tmp_path / "p.onnx")
    session = onnxruntime.InferenceSession(str(onnx), providers=["CPUExecutionProvider"])
    runner = module_of(export_policy(SHIPPED, tmp_path / "r.py")[0]).Runner()
    component = Native(policy_model(shipped, plain=True), "p")
    for acted in (
        stepped(component, seen, 0.4),
        session.run(None, {"observation": seen})[0],
        np.array([runner.act(o) for o in seen]),
        by_torch(shipped, seen),
    ):
        assert np.abs(acted - single).max() < 1e-6


def module_of(code: Path) -> Any:
    spec = importlib.util.spec_from_file_location(code.stem, code)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_runner_is_under_100_lines_and_needs_numpy_alone(tmp_path: Path) -> None:
    text = export_policy(SHIPPED, tmp_path / "r.py")[0].read_text()
    assert len(text.splitlines()) < 100
    imported = {
        name.split(".")[0]
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Import | ast.ImportFrom)
        for name in ([node.module or ""] if isinstance(node, ast.ImportFrom)
                     else [a.name for a in node.names])
    }  # fmt: skip
    assert imported <= {"__future__", "json", "pathlib", "runpy", "typing", "numpy"}


@pytest.mark.parametrize("taken", ["r.npz", "r.py"])
def test_a_runner_replaces_nothing_but_a_runner(taken: str, tmp_path: Path) -> None:
    (tmp_path / taken).write_bytes(SHIPPED.read_bytes())
    with pytest.raises(InputInvalid, match=rf"{taken}: exists and is no runner"):
        export_policy(SHIPPED, tmp_path / "r.py")
    assert (tmp_path / taken).read_bytes() == SHIPPED.read_bytes()
    for _ in range(2):  # its own it replaces
        assert len(export_policy(SHIPPED, tmp_path / "s.py")) == 2


def test_a_runner_where_nothing_can_be_written_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(InputInvalid, match=r"r\.py: cannot be written \(.*\); expected a folder"):
        export_policy(SHIPPED, tmp_path / "file" / "r.py")


@pytest.mark.parametrize("fmi", [2, 3])
def test_fmpy_runs_the_fmu_to_the_bits_of_the_component(
    fmi: int, shipped: Policy, tmp_path: Path
) -> None:
    from fmpy import simulate_fmu

    (file,) = export_policy(SHIPPED, tmp_path / "p.fmu", fmi=fmi)
    component = Native(policy_model(shipped), "p")
    v = component.description.variables
    given = {"eta": [-0.6, 1.0, 0.5, 0.0, 0.0, 0.4], "target": [0.3, -0.2, 0.55]}
    component.enter_initialization_mode(0.0, None)
    for name, value in given.items():
        component.set(v[name], value)
    component.exit_initialization_mode()
    for k in range(21):
        component.do_step(k / 50, 0.02)
    start = {f"{n}[{i + 1}]": x for n, value in given.items() for i, x in enumerate(value)}
    names = {2: ["tau_d[6]", "action[2]"], 3: ["tau_d", "action"]}[fmi]
    result = simulate_fmu(
        file, stop_time=0.42, step_size=0.02, output_interval=0.02, output=names,
        start_values=start if fmi == 2 else given, fmi_type="CoSimulation",
    )  # fmt: skip
    last = result[-1]
    for name in names:
        want = component.get(v[name.partition("[")[0]])
        read = last[name] if fmi == 3 else [last[name]]
        assert np.array_equal(read, want if fmi == 3 else [want[int(name[-2]) - 1]])


def zeros(observation: np.ndarray) -> np.ndarray:
    return np.zeros((len(observation), 2))


def returns_with(task: TargetTracking, system: System, episodes: int, **more: Any) -> Any:
    """Return the returns where the pilots themselves decide, and what is added is nothing."""
    task.system = system
    return evaluate(task, dict.fromkeys(task.agents, zeros), episodes, **more)


def test_the_fmu_in_the_co_simulation_tracks_as_the_policy_in_gymnasium(
    shipped: Policy, fmu: Path
) -> None:
    task = SCENARIOS["source"](**shipped.options)
    want = evaluate(task, {"tracker_1": shipped}, 4)
    system = task.system.replace("tracker_1.pilot", str(fmu))
    got = returns_with(task, system, 4, backend="master")
    assert np.abs(got.returns / want.returns - 1).max() < 0.01
    assert np.abs(got.returns - want.returns).max() < 1e-4
    assert want.summary()["return"] > 90


def test_a_team_with_obstacles_sees_in_the_kernel_what_it_sees_in_gymnasium(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    options: dict[str, Any] = {
        "n_trackers": 3,
        "n_obstacles": 3,
        "slots": [2, 4],
        "knowledge_range": 2.0,
    }
    task = TargetTracking(**options)
    width = len(task.limits("tracker_1")[0])
    policy = drawn(width, 2, task="target-tracking", options=options)
    limits = task.limits("tracker_1")
    seen = tuple(Named("o", float(a), float(b)) for a, b in zip(*limits, strict=True))
    policy = replace(policy, observation=seen)
    want = evaluate(task, dict.fromkeys(task.agents, policy), 16)
    source = f"policy:{policy.save(tmp_path / 'team.npz')}"
    system = task.system
    for agent in task.agents:
        system = system.replace(f"{agent}.pilot", source)
    begin = TargetTracking.start

    def start(self: TargetTracking, draws: Any) -> Mapping[str, Any]:
        given = dict(begin(self, draws))
        return given | {f"{a}.pilot.obstacles": given["target.obstacles"] for a in self.agents}

    monkeypatch.setattr(TargetTracking, "start", start)
    other = TargetTracking(**options)
    got = returns_with(other, system, 16)
    assert np.ptp(want.returns) > 1.0
    assert np.abs(got.returns - want.returns).max() < 1e-3


def test_a_runner_sees_what_the_task_sees(shipped: Policy, tmp_path: Path) -> None:
    options: dict[str, Any] = {"n_trackers": 2, "n_obstacles": 2}
    task = TargetTracking(**options)
    policy = replace(drawn(31, 2, task="target-tracking"), options=options)
    high = task.limits("tracker_1")[1]
    policy = replace(policy, observation=tuple(Named("o", -h, h) for h in map(float, high)))
    file = policy.save(tmp_path / "p.npz")
    runner = module_of(export_policy(file, tmp_path / "r.py")[0]).Runner()
    from uuvsim_cosim.envs.episodes.multi_agent import TeamSimulation

    stage = TeamSimulation(task, 1)
    now = stage.reset(seeds=[3])
    for _ in range(6):
        m = now.moment
        mine, other = (
            (m[f"{a}.hull.eta"][0], m[f"{a}.hull.nu"][0]) for a in ("tracker_1", "tracker_2")
        )
        cylinders = [tuple(o[:3]) for o in m.start["target.obstacles"][0] if 1.1 - o[3] <= 0.55]
        u_d = float(m["tracker_1.pilot.nu_d"][0, 0])
        target = m["target.position"][0]
        a, omega = runner.track(*mine, u_d, target, [other], cylinders)
        acted = policy(now.observation["tracker_1"])
        assert np.allclose([a, omega], acted[0] * [0.4, 1.5], atol=1e-5)
        now = stage.act({"tracker_1": acted, "tracker_2": np.array([[0.5, 0.2]])})
    stage.episodes.close()


# ---- what is connected ----------------------------------------------------------------------


def test_a_replacement_brings_its_connections_written_out(fmu: Path) -> None:
    system = load("target_tracking").replace("tracker_1.pilot", str(fmu))
    wires = [(w.connection.source, w.connection.target) for w in system.checked.wires]
    assert wires == [("target.position", "tracker_1.pilot_target")]
    assert ("pilot_target", "pilot.target") in [
        (x.name, x.path) for x in system.nested("tracker_1").exposed
    ]
    again = system.replace("tracker_1.pilot", str(fmu))
    assert again.checked.wires == system.checked.wires


def test_each_tracker_is_connected_to_the_others(tmp_path: Path) -> None:
    options: dict[str, Any] = {"n_trackers": 3, "slots": [2, 2]}
    policy = drawn(38, 2, task="target-tracking", options=options)
    file = policy.save(tmp_path / "team.npz")
    system = TargetTracking(**options).system.replace("tracker_2.pilot", f"policy:{file}")
    wires = {w.connection.target: w.connection.source for w in system.checked.wires}
    assert wires["tracker_2.pilot_eta_1"] == "tracker_1.eta"
    assert wires["tracker_2.pilot_eta_2"] == "tracker_3.eta"
    assert wires["tracker_2.pilot_nu_2"] == "tracker_3.nu"


def test_a_peer_that_is_not_there_leaves_a_remark() -> None:
    system = load("target_tracking").remove("target")
    system = system.replace("tracker_1.pilot", "model:policy")
    (note,) = system.notes
    assert "tracker_1.pilot.target: it is not connected, because target.position" in note


# ---- wrong input ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([str(SHIPPED), "-o", "p.dll"], "expected .fmu, .onnx, .pth, .py"),
        (["nowhere.npz", "-o", "p.fmu"], "nowhere.npz: no such file"),
        ([str(SHIPPED), "-o", "p.fmu", "--fmi", "1"], "expected 2 or 3"),
        ([str(SHIPPED), "-o", "p.fmu", "--platform", "atari"], "atari"),
        ([__file__, "-o", "p.fmu"], "expected a whole policy"),
    ],
)
def test_wrong_input_is_one_sentence(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert status_of(["export-policy", *arguments]) == 2
    said = capsys.readouterr().err
    assert words in said.replace("\n", " ")
    assert "Traceback" not in said


def test_a_file_that_is_not_whole_is_refused_by_the_component(tmp_path: Path) -> None:
    half = tmp_path / "half.npz"
    half.write_bytes(SHIPPED.read_bytes()[:9000])
    with pytest.raises((InputInvalid, SystemInvalid), match=r"half\.npz: .*BadZipFile"):
        load("target_tracking").replace("tracker_1.pilot", f"policy:{half}")


def test_a_policy_of_another_width_is_refused(tmp_path: Path) -> None:
    file = drawn(30, 2, task="source").save(tmp_path / "p.npz")
    with pytest.raises(InputInvalid, match=r"observes 30 numbers .* expected 31"):
        export_policy(file, tmp_path / "p.fmu")
