"""Export of a policy: FMU, ONNX, PyTorch tensors, or a NumPy runner."""

from __future__ import annotations

import inspect
import io
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from uuvsim_cosim.cache import cache_dir, content_hash, write_whole
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.policies.policy import Array, Named, Policy, SequenceRunner
from uuvsim_cosim.learn.training.loading import load_policies, policy_path

if TYPE_CHECKING:
    from uuvsim_cosim.models.declaration.model import Model

__all__ = [
    "ENDINGS",
    "export_policy",
    "in_units",
    "policy_model",
    "sequential",
    "tracking_settings",
]

ENDINGS = (".fmu", ".onnx", ".pth", ".py")


def export_policy(
    source: str | Path,
    out: str | Path,
    *,
    fmi: int = 3,
    platforms: Sequence[str] = ("host",),
    plain: bool = False,
) -> list[Path]:
    """Write a policy, from a file or a training's folder, in the format of the ending of `out`.

    Returns the files: for .py the runner and its weights, and for a decision transformer the code
    of its memory. With `plain`, an FMU of target tracking has an observation and an action instead
    of a pilot's connectors. Raises InputInvalid.
    """
    out = Path(out).expanduser()
    ending = out.suffix.lower()
    if ending not in ENDINGS:
        raise InputInvalid(out, f"ending {ending!r} was read", ", ".join(ENDINGS))
    path = policy_path(source)
    if path.is_file():
        policy = Policy.load(path)
    else:
        found = load_policies(path)
        policy = found[0]
        if len(found) != 1 or policy.agent:  # of one agent, the folder has lost the others'
            agents = ", ".join(p.agent for p in found)
            file = next(p.name for p in sorted(path.glob("*.npz")))
            raise InputInvalid(path, f"policies of {agents}", f"the file of one, as {file}")
    if policy.kind == "sequence":
        SequenceRunner(policy)  # refuses one that is not whole
    if ending == ".fmu":
        from uuvsim_cosim.fmus.export.fmu_file import build_fmu

        model = policy_model(policy, plain=plain)
        return [build_fmu(model, fmi=fmi, platforms=platforms, target=out)]  # type: ignore[arg-type]
    if ending == ".py":
        return _write_runner(policy, out, path)
    if ending == ".onnx":
        from uuvsim_cosim.learn.deployment.onnx import onnx_model

        return [_written(out, onnx_model(policy, out))]
    tensors = sequential(policy)
    try:
        import torch
    except ModuleNotFoundError:
        raise InputInvalid(
            out, "torch is missing", "the extra rl, `pip install 'uuvsim-cosim[rl]'`"
        ) from None
    buffer = io.BytesIO()
    torch.save({k: torch.from_numpy(v.copy()) for k, v in tensors.items()}, buffer)
    return [_written(out, buffer.getvalue())]


def policy_model(policy: Policy, *, plain: bool = False) -> Model:
    """Declare a policy as a component; its actions are in the units of the task's inputs.

    With `plain` they are in [-1, 1]. Raises InputInvalid as `in_units` does.
    """
    from uuvsim_cosim.models.declaration.library import declare

    kept = policy if plain else in_units(policy)
    # The tensors are hashed as bytes: their texts are abbreviated.
    tensors = (part for k, v in sorted(kept.tensors.items()) for part in (k, v.tobytes()))
    texts = [str(replace(kept, tensors={}, kind="sequence")), kept.kind]
    file = cache_dir("policies", content_hash([*texts, *tensors])) / "policy.npz"
    kept.save(file)
    return declare("policy", file=str(file), plain=int(plain))


def sequential(policy: Policy) -> dict[str, Array]:
    """Return tensors by the names in a torch.nn.Sequential of Linear, activation, …, Linear.

    Shift and scale of the observation become part of the first layer; "grid" stays as it is. Of a
    policy of kind "sequence" all stay as they are.
    """
    if policy.kind == "sequence":
        return dict(policy.tensors)
    given: dict[str, Array] = {}
    for i in range(policy.depth):
        weight, bias = policy.tensors[f"{i}.weight"], policy.tensors[f"{i}.bias"]
        if i == 0 and "shift" in policy.tensors:
            shift, scale = (policy.tensors[k].astype(np.float64) for k in ("shift", "scale"))
            bias = (bias - weight @ (shift * scale)).astype(np.float32)
            weight = (weight * scale).astype(np.float32)
        given |= {f"{2 * i}.weight": weight, f"{2 * i}.bias": bias}
    return given | {k: v for k, v in policy.tensors.items() if k == "grid"}


def tracking_settings(policy: Policy) -> Mapping[str, object] | None:
    """Return the settings of a target tracking task's observation; None for another task."""
    from uuvsim_cosim.learn.shared.task_ids import make_task

    try:
        task: Any = make_task(policy.task, policy.options)
    except InputInvalid:  # the task is not available here
        return None
    if not hasattr(task, "slots"):
        return None
    from uuvsim_cosim.envs.tasks.target_tracking import A_MAX, OMEGA_MAX, V_MAX

    return {
        "slots": list(task.slots),
        "arena": list(task.arena.size[:2]),
        "u_max": V_MAX,
        "action_step": float(task.action_step),
        "action_scale": [A_MAX, OMEGA_MAX],
        "knowledge_range": task.knowledge_range,
    }


def in_units(policy: Policy) -> Policy:
    """Return the policy with its actions' limits in the units of the inputs that its task acts on.

    A policy of target tracking stays as it is: a pilot's equations make a force of its actions.
    Raises InputInvalid if the task is not available, or acts on another number of inputs.
    """
    from uuvsim_cosim.envs.episodes.spaces import ActionBox
    from uuvsim_cosim.envs.task.task import TeamTask
    from uuvsim_cosim.learn.shared.task_ids import make_task
    from uuvsim_cosim.models.policies.policy_tracking import TEAMS
    from uuvsim_cosim.orchestrator.plan.flatten import flatten

    if policy.task in TEAMS:
        return policy
    instead = (
        "or `--plain` (of a source: policy:FILE.npz?plain=1) for actions in [-1, 1], without units"
    )
    try:
        task: Any = make_task(policy.task, policy.options)
    except InputInvalid as error:
        raise InputInvalid(
            f"policy of {policy.task}",
            f"its task, which gives the units of the actions, is not available ({error})",
            f"the task, {instead}",
        ) from None
    if hasattr(task, "slots"):  # of target tracking, by another name
        return policy
    channels = task.actions
    if isinstance(task, TeamTask):
        channels = channels.get(policy.agent) or next(iter(channels.values()))
    plan = flatten(task.system)
    box = ActionBox(plan, channels)
    if box.width != len(policy.action):
        raise InputInvalid(
            f"policy of {policy.task}",
            f"it has {len(policy.action)} actions, and the task acts on {box.width} inputs",
            f"the task as it was in the training, {instead}",
        )
    low, high = (box.scaled(np.full((1, box.width), s))[:, 0] for s in (-1.0, 1.0))
    variables = {
        f"{c.path}.{n}": v for c in plan.components for n, v in c.description.variables.items()
    }
    named = tuple(
        Named(box.name(i), float(low[i]), float(high[i]), variables[key].unit_of_element(e) or "1")
        for i, (key, e) in enumerate(box.targets)
    )
    settings = {**policy.settings, "action_step": str(task.action_step)}
    return replace(policy, action=named, settings=settings)


# ---- inside ---------------------------------------------------------------------------------


def _write_runner(policy: Policy, out: Path, source: Path) -> list[Path]:
    from uuvsim_cosim.learn.policies import runner, runner_sequence

    try:
        first = out.read_text(encoding="utf-8").partition("\n")[0]
    except (OSError, UnicodeDecodeError):
        first = ""
    if (runner.__doc__ or "").splitlines()[0] not in first:
        for path in (out, out.with_suffix(".npz")):
            if path.exists() and path.resolve() != source.resolve():
                raise InputInvalid(
                    path,
                    "exists and is no runner",
                    f"another name for {out.name} and {out.stem}.npz, its weights",
                )
    made = [_written(out, inspect.getsource(runner).encode())]
    if policy.kind == "sequence":
        beside = out.with_name(f"{out.stem}_sequence.py")
        made.append(_written(beside, inspect.getsource(runner_sequence).encode()))
    tracking = tracking_settings(policy)
    if tracking is not None:
        policy = replace(policy, settings={**policy.settings, "tracking": tracking})
    return [*made, policy.save(out.with_suffix(".npz"))]


def _written(out: Path, data: bytes) -> Path:
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        write_whole(out, data)
    except OSError as error:
        raise InputInvalid(
            out, f"cannot be written ({error.strerror})", "a folder that can be written"
        ) from error
    return out
