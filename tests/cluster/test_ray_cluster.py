"""Work on several machines: a Ray cluster of two nodes here, one of which is killed on the way."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.cli import status_of
from uuvsim_cosim.cluster import ray_cluster as cluster_versions
from uuvsim_cosim.cluster.ray_cluster import Cluster
from uuvsim_cosim.errors import InputInvalid, UuvsimError
from uuvsim_cosim.learn.data.collect import collect
from uuvsim_cosim.learn.training.config import TrainingConfig
from uuvsim_cosim.learn.training.judging import evaluate_all
from uuvsim_cosim.learn.training.ray_training import ALIKE, train_on
from uuvsim_cosim.learn.training.train import train

STUDY = """
system: bluerov2_hold
set: {hull.eta_0: [0, 0, 5, 0, 0, 0], guidance.count: 1}
duration: 1 s
every: 0.1 s
parameters: {"hull.v_c[1]": {grid: [0.0, 0.3, 0.6], unit: m/s}}
seeds: 12
metrics: {error: "rms(norm(hull.eta[1:2]))"}
"""
SMALL = TrainingConfig(
    "source", "sac", envs=8, steps=320, evaluate_every=160, evaluation_episodes=4,
    task_options={"horizon": 4},
    settings={"hidden": 16, "batch": 16, "warm_up": 32, "buffer": 200},
)  # fmt: skip
FILES = ("policy.npz", "best.npz", "evaluations.csv", "episodes.csv")


class Nodes:
    """A head and one more, on this machine's loopback."""

    def __init__(self) -> None:
        from ray.cluster_utils import Cluster as Processes

        own: dict[str, Any] = {
            "num_cpus": 1, "object_store_memory": 80 * 2**20, "include_dashboard": False,
        }  # fmt: skip
        with socket.create_server(("127.0.0.1", 0)) as free:
            port = free.getsockname()[1]
        outside = {"ray_client_server_port": port}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ResourceWarning)  # Ray leaves its server's logs open
            self._nodes = Processes(initialize_head=True, head_node_args=own | outside)
        self.from_outside = f"ray://127.0.0.1:{port}"
        self.session = Path(self._nodes.head_node.get_session_dir_path()).name
        self._other = self._nodes.add_node(**own)
        self.address = self._nodes.address

    def kill_one(self) -> None:
        self._nodes.remove_node(self._other, allow_graceful=False)

    def end(self) -> None:
        self._nodes.shutdown()

    def processes(self) -> list[str]:
        """Return the command lines of what runs of it."""
        found = []
        for place in Path("/proc").glob("[0-9]*"):
            try:
                said = (place / "cmdline").read_bytes() + (place / "environ").read_bytes()
            except OSError:
                continue
            if self.session.encode() in said:
                found.append(said.decode(errors="replace")[:200])
        return found


# ---- before there is a cluster ------------------------------------------------------------


@pytest.mark.parametrize(
    ("address", "said"),
    [
        ("nonsense", "no address; expected auto, local, HOST:PORT"),
        ("127.0.0.1:99999", "no address"),
        ("http://127.0.0.1:80", "no address"),
        ("127.0.0.1:1", "Connection refused; expected a Ray head there"),
        ("ray://127.0.0.1:1", "Connection refused; expected a Ray head there"),
    ],
)
def test_a_wrong_address_is_refused_in_one_sentence(
    address: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "s.yaml").write_text(STUDY)
    assert status_of(["study", str(tmp_path / "s.yaml"), "--ray", address]) == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1


def test_without_ray_one_sentence_says_which_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(InputInvalid, match=r"pip install 'uuvsim-cosim\[distributed\]'"):
        Cluster("local")


LOCAL = """
import json, os, subprocess, sys
from pathlib import Path
from uuvsim_cosim.cluster.ray_cluster import Cluster
os.environ["RAY_AUTH_MODE"] = "disabled"  # does not open a local cluster
before = dict(os.environ)
with Cluster("local", workers=1) as cluster:
    import ray
    address = ray.get_runtime_context().gcs_address
    session = Path(ray._private.worker.global_worker.node.get_session_dir_path())
    ask = "import sys, ray._raylet as r; r.GcsClient(sys.argv[1], 0).internal_kv_keys(b'', None)"
    stranger = os.environ | {"RAY_AUTH_TOKEN": "0" * 64}
    answers = [
        subprocess.run([sys.executable, "-c", ask, address], env=e, capture_output=True).returncode
        for e in (os.environ, stranger)
    ]
    private = session.parent.parent
    mode = f"{private.stat().st_mode & 0o777:o}"
    done = dict(cluster.spread(abs, [-1, -2]))
with Cluster("local", workers=1) as cluster:  # with a token of its own
    again = dict(cluster.spread(abs, [-3]))
print(json.dumps({
    "host": address.rpartition(":")[0], "own": answers[0] == 0, "stranger": answers[1] == 0,
    "mode": mode, "gone": not private.exists(), "done": [*done.values(), *again.values()],
    "left": os.environ.get("RAY_AUTH_MODE"), "token": "RAY_AUTH_TOKEN" in os.environ,
}))
"""


def test_a_local_cluster_is_closed_to_other_accounts() -> None:
    pytest.importorskip("ray")
    program = [sys.executable, "-c", LOCAL]
    done = subprocess.run(program, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout.splitlines()[-1]) == {
        "host": "127.0.0.1", "own": True, "stranger": False, "mode": "700", "gone": True,
        "done": [1, 2, 3], "left": "disabled", "token": False,
    }  # fmt: skip


# ---- with one -----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def nodes() -> Iterator[Nodes]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RAY_USAGE_STATS_ENABLED", "0")
        # Otherwise Ray takes the address of a network interface, even for 127.0.0.1.
        patch.setattr("ray._private.ray_constants.ENABLE_RAY_CLUSTER", False)
        patch.setenv("RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER", "0")  # the same, in other processes
        made = Nodes()
        try:
            yield made
        finally:
            made.end()
        assert made.processes() == []


@pytest.fixture(scope="module")
def cluster(nodes: Nodes) -> Iterator[Cluster]:
    """One connection for all: a command that is told the address uses it too."""
    with Cluster(nodes.address, alike=ALIKE) as connected:
        yield connected


def test_a_study_has_the_same_table_on_a_cluster(
    cluster: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("s.yaml").write_text(STUDY)
    assert status_of(["study", "s.yaml", "-o", "here", "--no-report"]) == 0
    there = ["study", "s.yaml", "-o", "there", "--no-report", "--ray", cluster.address]
    assert status_of(there) == 0
    assert Path("here/runs.parquet").read_bytes() == Path("there/runs.parquet").read_bytes()


def test_a_study_has_the_same_table_from_a_machine_outside_of_the_cluster(
    nodes: Nodes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("s.yaml").write_text(STUDY)
    asked = ["study", "s.yaml", "--no-report"]
    assert status_of([*asked, "-o", "here"]) == 0
    there = [*asked, "-o", "there", "--ray", nodes.from_outside]
    command = [sys.executable, "-m", "uuvsim_cosim", *there]
    environment = os.environ | {"RAY_AUTH_MODE": "disabled"}
    done = subprocess.run(command, check=False, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stdout + done.stderr
    assert Path("here/runs.parquet").read_bytes() == Path("there/runs.parquet").read_bytes()


def _dies_once(given: tuple[Path, int]) -> tuple[int, int]:
    marks, number = given
    try:
        (marks / f"{number}").touch(exist_ok=False)
    except FileExistsError:
        return number, os.getpid()
    if number == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return number, os.getpid()


def test_a_worker_that_dies_is_replaced_and_nothing_is_counted_twice(
    cluster: Cluster, tmp_path: Path
) -> None:
    asked = [(tmp_path, k) for k in range(4)]
    came = [number for _, (number, _) in cluster.spread(_dies_once, asked)]
    assert sorted(came) == list(range(4))


def _dies(number: int) -> int:
    os._exit(1)


def test_what_kills_every_worker_is_told_in_one_sentence(
    cluster: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("uuvsim_cosim.cluster.ray_cluster.RETRIES", 1)
    with pytest.raises(UuvsimError, match=r"ended without an answer, 2 times") as told:
        cluster.call(_dies, 1)
    assert "\n" not in str(told.value)


def _wrong(number: int) -> int:
    raise InputInvalid(f"number {number}; expected another")


def test_a_mistake_is_the_same_sentence_there(cluster: Cluster) -> None:
    with pytest.raises(InputInvalid, match=r"^number 3; expected another$"):
        list(cluster.spread(_wrong, [3]))


def test_what_follows_a_piece_is_worked_on_in_turn(cluster: Cluster) -> None:
    found = [
        (k, r) for k, r in cluster.spread(_next, [0, 10], lambda k, r: r if r % 10 < 3 else None)
    ]
    assert sorted(found) == [(0, 1), (0, 2), (0, 3), (1, 11), (1, 12), (1, 13)]


def _next(number: int) -> int:
    return number + 1


@pytest.mark.parametrize("policy", ["scripted", "mixed"])
def test_a_dataset_is_the_same_from_a_cluster(
    cluster: Cluster, policy: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    options = {"horizon": 2}
    monkeypatch.setattr("uuvsim_cosim.learn.data.collect.AT_ONCE", 8)
    here = collect("source", policy, 20, options=options)
    there = collect("source", policy, 20, options=options, cluster=cluster)
    assert len(here.episodes) == len(there.episodes) == 20
    for one, two in zip(here.episodes, there.episodes, strict=True):
        assert np.array_equal(one.observation, two.observation)
        assert np.array_equal(one.action, two.action)
        assert np.array_equal(one.reward, two.reward)


def test_another_version_on_a_machine_is_refused(
    cluster: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = cluster_versions.versions()
    monkeypatch.setattr(
        "uuvsim_cosim.cluster.ray_cluster.versions", lambda _: {**here, "casadi": "9.9"}
    )
    with pytest.raises(InputInvalid, match=r"machine .*: casadi \d.*; expected 9\.9, as here$"):
        Cluster(cluster.address)


def test_a_process_that_is_connected_is_not_connected_elsewhere(cluster: Cluster) -> None:
    with pytest.raises(InputInvalid, match=r"connected to 127\.0\.0\.1:.* already"):
        Cluster("127.0.0.1:9")


def test_trainings_go_on_to_the_same_bits_when_a_machine_is_killed(
    cluster: Cluster, nodes: Nodes, tmp_path: Path
) -> None:
    configs = [SMALL, SMALL.changed(seed=1), SMALL.changed(seed=2)]
    for config in configs:
        train(config, folder=tmp_path / f"here{config.seed}", tensorboard=False)
    told: list[float] = []

    def progress(_: str, done: float, total: float) -> None:
        if not told:
            nodes.kill_one()
        told.append(done)

    folders = [tmp_path / f"there{c.seed}" for c in configs]
    done = train_on(cluster, configs, folders, progress=progress, seconds=0.02)
    assert len(told) > 3  # in pieces
    assert told[-1] == 960
    assert [d.evaluations[-1]["step"] for d in done] == [320] * 3
    for config in configs:
        for name in FILES:
            here = (tmp_path / f"here{config.seed}" / name).read_bytes()
            assert here == (tmp_path / f"there{config.seed}" / name).read_bytes()


def test_policies_are_judged_alike_on_what_is_left_of_a_cluster(
    cluster: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    from uuvsim_cosim.envs.tasks.scripted import scripted_policy
    from uuvsim_cosim.learn.shared.task_ids import make_task

    options = {"horizon": 2}
    policies = {"scripted": scripted_policy(make_task("source", options))}
    monkeypatch.setattr("uuvsim_cosim.learn.training.judging.AT_ONCE", 8)
    here = evaluate_all("source", options, policies, 20, 7)["scripted"]
    there = evaluate_all("source", options, policies, 20, 7, cluster=cluster)["scripted"]
    assert np.array_equal(here.returns, there.returns)
    assert here.metrics.keys() == there.metrics.keys()
