"""Pages of the environments that ship: spaces with units, options and a picture."""

from __future__ import annotations

import importlib
import inspect
import io
from typing import Any

import gymnasium
import numpy as np
from components import as_markdown

import uuvsim_cosim.envs
from uuvsim_cosim import System
from uuvsim_cosim.envs.registration import SHIPPED
from uuvsim_cosim.orchestrator.values.endpoints import find_variable

TASKS = "uuvsim_cosim.envs.tasks"
assert uuvsim_cosim.envs  # importing it registers the environments


def slug(id: str) -> str:
    """Return the file name of an environment's page, without ending."""
    return id.removeprefix("uuvsim/").removesuffix("-v0").lower()


def pages() -> dict[str, str | bytes]:
    """Return the pages and pictures of all environments, by file name."""
    texts: dict[str, str | bytes] = {}
    rows = []
    for id, target in SHIPPED.items():
        page, picture = _page(id, target)
        texts[f"{slug(id)}.md"], texts[f"{slug(id)}.png"] = page, picture
        rows.append(f"| [`{id}`]({slug(id)}.md) | {_first_line(_made_by(target))} |")
    texts["index.md"] = (
        "# Environments\n\nEach environment is a system of components with a task: actions, "
        "observations, reward and end. `uuvsim envs` lists them. "
        "[Use a shipped task](../../learning/tasks.md) shows how to choose one and to set its "
        "options, [environments](../../learning/environments.md) how to write one."
        "\n\n| id | task |\n|---|---|\n" + "\n".join(rows) + "\n\n```{toctree}\n:hidden:\n\n"
        + "\n".join(slug(id) for id in SHIPPED) + "\n```\n"
    )  # fmt: skip
    return texts


def _made_by(target: str) -> Any:
    module, _, name = target.partition(":")
    return getattr(importlib.import_module(module), name)


def _first_line(made_by: Any) -> str:
    return " ".join((inspect.getdoc(made_by) or "").split("\n\n")[0].split()).replace("|", "\\|")


def example(id: str) -> str:
    """Return the code with which a reader makes an environment and steps it."""
    return (
        f'import gymnasium\n\nenv = gymnasium.make("uuvsim_cosim.envs:{id}")\n'
        "observation, info = env.reset(seed=0)\n"
        "observation, reward, terminated, truncated, info = env.step(env.action_space.sample())\n"
        f'many = gymnasium.make_vec("{id}", num_envs=64)  # one kernel\n'
    )


def _page(id: str, target: str) -> tuple[str, bytes]:
    made_by = _made_by(target)
    env = gymnasium.make(id, render_mode="rgb_array")
    env.reset(seed=0)
    for _ in range(20):
        env.step(np.zeros(env.action_space.shape, np.float32))  # type: ignore[arg-type]
    picture = _png(np.asarray(env.render()))
    inner: Any = env.unwrapped
    system = inner.task.system
    text = inspect.getdoc(made_by) or ""
    observed = " ".join(str(env.observation_space).split())
    parts = [
        f"# {id}",
        f"```{{image}} {slug(id)}.png\n:alt: one environment after 20 actions\n:width: 420px\n```",
        text.replace("``", "`").replace("|", "\\|"),
        f"```python\n{example(id)}```",
        "The part before the colon imports `uuvsim_cosim.envs`, which registers the environments; "
        f"after that import, `gymnasium.make(\"{id}\")` is enough.",
        "## Spaces",
        f"| | space |\n|---|---|\n| action | `{env.action_space}` |\n"
        f"| observation | `{observed}` |\n",
        _channels("action", inner.task.actions, system),
        _channels("observation", inner.task.observations, system),
        "The task computes its observation itself: [tasks that ship](../../learning/tasks.md) "
        "lists its elements."
        if not inner.task.observations else "",
        "## Time",
        f"An action lasts {float(inner.task.action_step):g} s; an episode is truncated after "
        f"{float(inner.task.horizon):g} s, which is "
        f"{int(inner.task.horizon / inner.task.action_step)} actions.",
        "## Options",
        _options(made_by),
        *_inherited(made_by),
        "## System",
        f"The task runs in the system `{system.name}`, which has {len(system.components)} "
        "components.",
    ]  # fmt: skip
    env.close()
    return "\n\n".join(p for p in parts if p) + "\n", picture


def _channels(title: str, channels: Any, system: System) -> str:
    """Return a table of the connectors that a space consists of, with their limits and units."""
    if not channels:
        return ""
    rows = [
        f"| `{c.name}` | {_limit(c.low)} | {_limit(c.high)} | {_unit(c, system)} |"
        for c in channels
    ]
    head = f"| {title} | value at -1 | value at 1 | unit |\n|---|---|---|---|\n"
    return head + "\n".join(rows)


def _unit(channel: Any, system: System) -> str:
    """Return the unit of a connector, or those of its elements."""
    if channel.unit:
        return str(channel.unit)
    path, _, name = channel.name.rpartition(".")
    variable, elements, _ = find_variable(name, system.describe(path))
    return ", ".join(dict.fromkeys(variable.unit_of_element(i) or "1" for i in elements))


def _limit(value: Any) -> str:
    """Return one limit, or one for each element."""
    if value is None:
        return "of the variable"
    return ", ".join(f"{x:g}" for x in np.atleast_1d(value))


def _options(made_by: Any) -> str:
    """Return a table of the options of a task, with those of its base classes."""
    owners = [made_by.__init__, *(c.__init__ for c in made_by.__mro__[1:])] if inspect.isclass(
        made_by
    ) else [made_by]  # fmt: skip
    rows: dict[str, str] = {}
    for owner in owners:
        if not getattr(owner, "__module__", "").startswith("uuvsim_cosim"):
            continue
        for p in inspect.signature(owner).parameters.values():
            if p.kind is p.KEYWORD_ONLY and p.default is not p.empty:
                kind = str(p.annotation).replace("|", "\\|")
                rows.setdefault(p.name, f"| `{p.name}` | `{kind}` | `{p.default!r}` |")
    if not rows:
        return (
            "Options are those of [target tracking](targettracking.md). "
            "[The benchmark](../../learning/target_tracking.md) explains its reward."
        )
    return "| option | type | default |\n|---|---|---|\n" + "\n".join(rows.values())


def _inherited(made_by: Any) -> list[str]:
    """Return what the bases of a task in this package say of its reward and options."""
    if not inspect.isclass(made_by):
        return []
    return [
        part
        for base in made_by.__mro__[1:]
        if base.__module__.startswith(f"{TASKS}.")
        for part in (f"### Of `{base.__name__}`", as_markdown(inspect.getdoc(base) or ""))
    ]


def _png(pixels: np.ndarray) -> bytes:
    import matplotlib as mpl

    mpl.use("svg")
    from matplotlib import image

    out = io.BytesIO()
    image.imsave(out, pixels, format="png", metadata={"Software": ""})
    return out.getvalue()
