"""Window for render_mode "human": it shows frames in time, and may be closed at any time."""

from __future__ import annotations

import time
from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid

__all__ = ["Window"]

INSTEAD = (
    'use render_mode="rgb_array", and gymnasium.wrappers.RecordVideo to get a film, '
    "or run on a machine with a screen"
)
NAP = 0.02  # longest time without looking at the window's events [s]


class Window:
    """Shows frames (height, width, 3) of uint8 in a tkinter window, `render_fps` of them a second.

    `show` waits until the frame before has been seen for 1/render_fps, and never longer; a slow
    simulation is shown as it comes, without catching up.  Once the user has closed the window,
    `show` returns False, at once, and draws nothing.  To be used from one thread, the main one.
    """

    def __init__(
        self,
        title: str = "uuvsim",
        *,
        render_fps: float = 30.0,
        clock: Callable[[], float] = time.perf_counter,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        if not 0.0 < render_fps < np.inf:
            raise InputInvalid("window, render_fps", render_fps, "a number above 0 Hz")
        self.period = 1.0 / render_fps
        self._clock, self._sleep = clock, sleep
        self._next = -np.inf
        self._tkinter = _tkinter()
        try:
            self._root: Any = self._tkinter.Tk(className="uuvsim")
        except self._tkinter.TclError as error:
            raise InputInvalid(f'render_mode "human": no screen ({error}); {INSTEAD}') from None
        self._image: Any = None
        self._shape: tuple[int, ...] = ()
        self._root.title(title)
        self._root.resizable(False, False)
        self._root.protocol("WM_DELETE_WINDOW", self.close)
        self._root.bind("<Escape>", lambda _event: self.close())
        self._label: Any = self._tkinter.Label(self._root, borderwidth=0)
        self._label.pack()

    @property
    def closed(self) -> bool:
        """Whether the window is gone, by `close` or by its user."""
        return self._root is None

    def show(self, frame: NDArray[np.uint8]) -> bool:
        """Show a frame when its time has come; False if the window is closed."""
        if frame.dtype != np.uint8 or frame.ndim != 3 or frame.shape[2] != 3:
            raise InputInvalid(
                "window",
                f"frame of {frame.dtype} {frame.shape}",
                "uint8 (height, width, 3), as render() gives with rgb_array",
            )
        while not self.closed and (wait := self._next - self._clock()) > 0.0:
            self._look()
            self._sleep(min(wait, NAP))
        if self.closed:
            return False
        now = self._clock()
        late = now - self._next >= self.period
        self._next = (now if late else self._next) + self.period
        height, width = frame.shape[:2]
        ppm = b"P6 %d %d 255\n" % (width, height) + frame.tobytes()
        try:
            if self._image is not None and self._shape == frame.shape:
                self._image.configure(data=ppm)
            else:
                self._image = self._tkinter.PhotoImage(master=self._root, data=ppm, format="PPM")
                self._shape = frame.shape
                self._label.configure(image=self._image)
        except self._tkinter.TclError:  # its display has gone, or the window was destroyed
            self.close()
        self._look()
        return not self.closed

    def close(self) -> None:
        """Destroy the window; a second call does nothing."""
        root, self._root = self._root, None
        self._image = self._label = None
        if root is not None:
            try:
                root.destroy()
            except self._tkinter.TclError:
                return  # it is destroyed already

    def _look(self) -> None:
        """Let the window draw itself and take its user's clicks."""
        if self._root is None:
            return
        try:
            self._root.update()
        except self._tkinter.TclError:
            self.close()


def _tkinter() -> ModuleType:
    try:
        import tkinter
    except ImportError as error:
        raise InputInvalid(
            f'render_mode "human": this Python has no tkinter ({error}); {INSTEAD}, '
            "or install it (Debian and Ubuntu: apt install python3-tk)"
        ) from None
    return tkinter
