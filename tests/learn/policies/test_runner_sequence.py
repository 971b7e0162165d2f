"""A decision transformer that leaves, as a runner or as ONNX, acts as it does in evaluations."""

import ast
import runpy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
import pytest

from uuvsim_cosim.cli import status_of
from uuvsim_cosim.content import content
from uuvsim_cosim.learn.data.dataset_files import read_dataset
from uuvsim_cosim.learn.deployment.export import export_policy
from uuvsim_cosim.learn.policies.policy import Named, Policy, SequenceRunner

SHIPPED = content("models", "policies") / "transition_1_dt.npz"
OBSERVED, ACTED, HIDDEN, K, TIMES = 5, 2, 12, 4, 9


def drawn(activation: str = "gelu", **settings: Any) -> Policy:
    """Draw a small one."""
    r = np.random.default_rng(7)
    linear = {"embed_return": (HIDDEN, 1), "embed_observation": (HIDDEN, OBSERVED),
              "embed_action": (HIDDEN, ACTED), "head": (ACTED, HIDDEN)}  # fmt: skip
    norms = ["embed_norm", "norm"]
    for i in range(2):
        sizes = ((3 * HIDDEN, HIDDEN), (HIDDEN, HIDDEN), (40, HIDDEN), (HIDDEN, 40))
        names = ("attention.qkv", "attention.out", "wide", "narrow")
        linear |= {f"blocks.{i}.{k}": s for k, s in zip(names, sizes, strict=True)}
        norms += [f"blocks.{i}.norm_{j}" for j in (1, 2)]
    tensors = {"embed_time.weight": r.normal(size=(TIMES, HIDDEN))}
    for name, size in linear.items():
        tensors[f"{name}.weight"] = r.normal(size=size) / np.sqrt(size[1])
        tensors[f"{name}.bias"] = r.normal(size=size[0]) / 10
    for name in norms:
        tensors[f"{name}.weight"] = r.uniform(0.5, 1.5, HIDDEN)
        tensors[f"{name}.bias"] = r.normal(size=HIDDEN) / 10
    if activation == "relu":
        tensors |= {"shift": r.normal(size=OBSERVED), "scale": r.uniform(0.5, 2, OBSERVED)}
    return Policy(
        kind="sequence",
        tensors={k: v.astype(np.float32) for k, v in tensors.items()},
        observation=tuple(Named(f"o[{i}]", -3.0, 3.0) for i in range(OBSERVED)),
        action=tuple(Named(f"a[{i}]", -1.0, 1.0) for i in range(ACTED)),
        task="my:Task",
        settings={"context": K, "heads": 3, "activation": activation, "return_to_go": 50.0,
                  "return_scale": 10.0, "reward": 2.0, **settings},
    )  # fmt: skip


def runner_of(folder: Path, policy: Path = SHIPPED) -> Any:
    return runpy.run_path(str(export_policy(policy, folder / "pilot.py")[0]))["Runner"]()


def by_onnx(file: Path, observations: np.ndarray) -> np.ndarray:
    """Act along observations (steps, n, width)."""
    session = onnxruntime.InferenceSession(str(file), providers=["CPUExecutionProvider"])
    shape = session.get_inputs()[1].shape[1:]
    memory = {
        "history": np.zeros((observations.shape[1], *shape), np.float32),
        "past": np.array(0),
    }
    acted = []
    for o in observations:
        action, *memory_next = session.run(None, {"observation": o, **memory})
        memory = dict(zip(memory, memory_next, strict=True))
        acted.append(action)
    return np.array(acted)


@pytest.fixture(scope="module")
def seen() -> np.ndarray:
    """Observe three episodes of the shipped data, (51, 3, 31)."""
    episodes = read_dataset(content("models", "datasets") / "transition_1_scripted.npz").episodes
    return np.stack([e.observation for e in episodes[:3]], 1).astype(np.float32)


def test_a_runner_acts_to_the_bits_of_evaluations_and_begins_anew(
    seen: np.ndarray, tmp_path: Path
) -> None:
    runner, inside = runner_of(tmp_path), SequenceRunner(Policy.load(SHIPPED))
    for k in (0, 1):
        runner.begin()
        inside.begin()
        for o in seen[:, k]:
            assert np.array_equal(runner.act(o), inside(o[None])[0])
    before = runner.act(seen[0, 0])
    runner.begin()
    assert not np.array_equal(runner.act(seen[0, 0]), before)


def test_a_runner_tracks_with_what_it_remembers(tmp_path: Path) -> None:
    runner, observed = runner_of(tmp_path), list[Any]()
    act = runner.act

    def watched(observation: Any) -> Any:
        observed.append(np.array(observation))
        return act(observation)

    runner.act = watched
    given = [
        ([0.1 * k, 0.2, 0.5, 0, 0, 0.1 * k], [0.2, 0, 0, 0, 0, 0.1], 0.2, [1, 1 - 0.1 * k, 0.5])
        for k in range(12)
    ]
    tracked = np.array([runner.track(*one, obstacles=[(0.5, -0.5, 0.2)]) for one in given])
    inside = SequenceRunner(Policy.load(SHIPPED))
    acted = np.array([inside(o[None])[0] for o in observed])
    assert np.allclose(tracked, acted * [0.4, 1.5], rtol=0, atol=1e-6)
    assert observed[1][12:14].any()  # the target has moved
    runner.begin()
    again = runner.track(*given[0], obstacles=[(0.5, -0.5, 0.2)])
    assert np.array_equal(again, tracked[0])


def test_both_files_are_under_100_lines_and_need_numpy_alone(tmp_path: Path) -> None:
    written = export_policy(SHIPPED, tmp_path / "pilot.py")
    assert [f.name for f in written] == ["pilot.py", "pilot_sequence.py", "pilot.npz"]
    for file in written[:2]:
        text = file.read_text()
        assert len(text.splitlines()) < 100
        imported = {
            name.split(".")[0]
            for node in ast.walk(ast.parse(text))
            if isinstance(node, ast.Import | ast.ImportFrom)
            for name in ([node.module or ""] if isinstance(node, ast.ImportFrom)
                         else [a.name for a in node.names])
        }  # fmt: skip
        assert imported <= {"__future__", "json", "math", "pathlib", "runpy", "typing", "numpy"}


@pytest.mark.parametrize("activation", ["relu", "gelu"])
def test_onnx_acts_as_evaluations_do_within_1e_6(activation: str, tmp_path: Path) -> None:
    policy = drawn(activation)
    seen = np.random.default_rng(1).uniform(-2, 2, (14, 3, OBSERVED)).astype(np.float32)
    inside = SequenceRunner(policy)
    want = np.array([inside(o) for o in seen])
    (file,) = export_policy(policy.save(tmp_path / "p.npz"), tmp_path / "p.onnx")
    assert np.abs(by_onnx(file, seen) - want).max() < 1e-6
    assert np.ptp(want) > 0.2
    runner = runner_of(tmp_path, tmp_path / "p.npz")
    assert np.abs([runner.act(o) for o in seen[:, 0]] - want[:, 0]).max() < 1e-6


def test_the_trained_transformer_in_onnx_is_as_far_as_float32_is_from_float64(
    seen: np.ndarray, tmp_path: Path
) -> None:
    (file,) = export_policy(SHIPPED, tmp_path / "p.onnx")
    inside = SequenceRunner(Policy.load(SHIPPED))
    apart = np.abs(by_onnx(file, seen) - [inside(o) for o in seen])
    assert apart.max() < 2e-5
    assert np.quantile(apart, 0.9) < 1e-6


def test_onnx_does_not_see_places_before_the_episode(tmp_path: Path) -> None:
    (file,) = export_policy(drawn().save(tmp_path / "p.npz"), tmp_path / "p.onnx")
    session = onnxruntime.InferenceSession(str(file), providers=["CPUExecutionProvider"])
    r = np.random.default_rng(2)
    o, junk = r.normal(size=(2, OBSERVED)), r.normal(size=(2, K, 1 + OBSERVED + ACTED))
    first, later = (
        [session.run(["action"], {"observation": o.astype(np.float32), "past": np.array(past),
                                  "history": h.astype(np.float32)})[0] for h in (0 * junk, junk)]
        for past in (0, 2)
    )  # fmt: skip
    assert np.array_equal(first[0], first[1])
    assert not np.allclose(later[0], later[1], atol=1e-3)


@pytest.mark.parametrize("ending", [".py", ".onnx"])
@pytest.mark.parametrize(
    ("without", "words"),
    [("context", "'context'"), ("blocks.1.attention.out.bias", "'blocks.1.attention.out.bias'"),
     ("embed_time.weight", "'embed_time.weight'")],
)  # fmt: skip
def test_a_transformer_that_is_not_whole_is_refused_in_one_sentence(
    ending: str, without: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = drawn()
    tensors, settings = (
        {k: v for k, v in kept.items() if k != without} for kept in (whole.tensors, whole.settings)
    )
    policy = replace(whole, tensors=tensors, settings=settings)
    file, out = policy.save(tmp_path / "p.npz"), tmp_path / f"r{ending}"
    assert status_of(["export-policy", str(file), "-o", str(out)]) == 2
    said = capsys.readouterr().err.replace("\n", " ")
    assert words in said
    assert "expected a decision transformer" in said
    assert not out.exists()


def test_the_command_tells_each_file_that_it_wrote(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert status_of(["export-policy", str(SHIPPED), "-o", str(tmp_path / "runner.py")]) == 0
    said = capsys.readouterr().out
    for name in ("runner.py", "runner_sequence.py", "runner.npz"):
        assert name in said
        assert (tmp_path / name).is_file()
