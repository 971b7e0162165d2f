"""Rendering of environments: pictures, or a window."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.plan.plan import Plan

if TYPE_CHECKING:
    from uuvsim_cosim.envs.pictures.picture import Picture
    from uuvsim_cosim.envs.pictures.window import Window

__all__ = ["Screen", "hulls"]

MODES = ("rgb_array", "human")


@final
class Screen:
    """Drawing of moments of environments in one of Gymnasium's render modes, if any."""

    def __init__(self, mode: str | None) -> None:
        if mode is not None and mode not in MODES:
            raise InputInvalid(f"render_mode {mode!r}", f"one of {', '.join(MODES)}, or None")
        self.mode = mode
        self._pictures: dict[int, Picture] = {}
        self._window: Window | None = None
        self._hulls: list[str] | None = None

    def changed(self, render: Callable[[], object]) -> None:
        """Call an environment's `render` if a window shows it."""
        if self.mode == "human":
            render()

    def frame(self, task: Any, moment: Any, row: int) -> NDArray[np.uint8] | None:
        """Draw one environment: pixels (height, width, 3), or None in a window or without mode."""
        if self.mode is None:
            import gymnasium

            gymnasium.logger.warn(
                "render() without a render_mode draws nothing; give render_mode='rgb_array' "
                "when making the environment"
            )
            return None
        from uuvsim_cosim.envs.pictures.picture import Picture, Vehicle, View

        picture = self._pictures.get(row)
        if picture is None:
            picture = self._pictures[row] = Picture()
        view = task.view(moment, row)
        if view is None:
            if self._hulls is None:
                self._hulls = hulls(flatten(task.system))
            vehicles = []  # bodies of half a metre
            for path in self._hulls:
                eta = np.asarray(moment[f"{path}.eta"][row], float)
                vehicles.append(Vehicle(path, eta.tolist(), length=0.5, breadth=0.35))
            view = View(vehicles=vehicles, time=float(moment.time[row]))
        pixels = picture.draw(view)
        if self.mode == "rgb_array":
            return pixels
        if self._window is None:
            from uuvsim_cosim.envs.pictures.window import Window

            self._window = Window(type(task).__name__, render_fps=float(1 / task.action_step))
        self._window.show(pixels)
        return None

    def close(self) -> None:
        """Close the window; a second call does nothing."""
        window, self._window = self._window, None
        if window is not None:
            window.close()


def hulls(plan: Plan) -> list[str]:
    """Return the paths of components that have a pose `eta` (6) and are moved by `tau` (6)."""
    found = []
    for c in plan.components:
        eta, tau = (c.description.variables.get(name) for name in ("eta", "tau"))
        if eta is not None and (eta.causality, eta.shape) == ("output", (6,)) and tau is not None:
            found.append(c.path)
    return found
