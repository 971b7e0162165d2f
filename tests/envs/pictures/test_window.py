"""The window: with a real display where Xvfb or one is there, its sentence where not, and fakes."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.envs.pictures.window import Window
from uuvsim_cosim.errors import InputInvalid

FRAME = np.zeros((12, 20, 3), np.uint8)


class FakeTclError(Exception):
    pass


class FakeRoot:
    def __init__(self, **_: Any) -> None:
        self.destroyed = False
        self.updates = 0
        self.on_close: Any = None
        self.bound: dict[str, Any] = {}
        self.closes_at: int | None = None

    def title(self, text: str) -> None:
        self.text = text

    def resizable(self, *_: bool) -> None: ...

    def protocol(self, name: str, call: Any) -> None:
        assert name == "WM_DELETE_WINDOW"
        self.on_close = call

    def bind(self, event: str, call: Any) -> None:
        self.bound[event] = call

    def update(self) -> None:
        if self.destroyed:
            raise FakeTclError("application has been destroyed")
        self.updates += 1
        if self.updates == self.closes_at:
            self.on_close()

    def destroy(self) -> None:
        if self.destroyed:
            raise FakeTclError("application has been destroyed")
        self.destroyed = True


class FakeImage:
    made: list[FakeImage] = []  # noqa: RUF012

    def __init__(self, *, master: FakeRoot, data: bytes, format: str) -> None:
        self.data = [data]
        FakeImage.made.append(self)

    def configure(self, *, data: bytes) -> None:
        self.data.append(data)


class FakeClock:
    """Time that only sleeping moves."""

    def __init__(self) -> None:
        self.now = 100.0
        self.slept: list[float] = []

    def __call__(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds
        self.slept.append(seconds)


@pytest.fixture
def clock() -> FakeClock:
    return FakeClock()


@pytest.fixture
def window(monkeypatch: pytest.MonkeyPatch, clock: FakeClock) -> Window:
    label = SimpleNamespace(pack=lambda: None, configure=lambda **_: None)
    fake = SimpleNamespace(
        Tk=FakeRoot, TclError=FakeTclError, PhotoImage=FakeImage, Label=lambda *_, **__: label
    )
    monkeypatch.setitem(sys.modules, "tkinter", fake)
    FakeImage.made.clear()
    return Window("a title", render_fps=10.0, clock=clock, sleep=clock.sleep)


def test_frames_are_shown_one_period_apart(window: Window, clock: FakeClock) -> None:
    shown = []
    for _ in range(5):
        assert window.show(FRAME)
        shown.append(clock.now)
    np.testing.assert_allclose(np.diff(shown), 0.1, atol=1e-9)


def test_a_slow_simulation_is_not_caught_up_with(window: Window, clock: FakeClock) -> None:
    window.show(FRAME)
    clock.now += 5.0
    window.show(FRAME)
    before = clock.now
    window.show(FRAME)
    assert clock.now - before == pytest.approx(0.1)


def test_the_first_frame_comes_at_once(window: Window, clock: FakeClock) -> None:
    window.show(FRAME)
    assert clock.slept == []


def test_a_frame_reaches_tkinter_as_a_ppm(window: Window) -> None:
    frame = np.arange(12 * 20 * 3, dtype=np.uint32).astype(np.uint8).reshape(12, 20, 3)
    window.show(frame)
    assert FakeImage.made[0].data[0] == b"P6 20 12 255\n" + frame.tobytes()


def test_one_image_is_reused_until_the_size_changes(window: Window) -> None:
    window.show(FRAME)
    window.show(FRAME)
    assert len(FakeImage.made) == 1
    window.show(np.zeros((6, 6, 3), np.uint8))
    assert len(FakeImage.made) == 2


def test_a_window_closed_by_its_user_shows_nothing_and_does_not_wait(
    window: Window, clock: FakeClock
) -> None:
    window.show(FRAME)
    root: Any = window._root
    root.on_close()
    assert window.closed
    assert root.destroyed
    assert not window.show(FRAME)
    assert clock.slept == []


def test_a_window_may_be_closed_while_a_frame_waits(window: Window) -> None:
    window.show(FRAME)
    root: Any = window._root
    root.closes_at = root.updates + 1
    assert not window.show(FRAME)


def test_escape_closes_the_window(window: Window) -> None:
    root: Any = window._root
    root.bound["<Escape>"](None)
    assert window.closed


def test_a_window_destroyed_from_outside_counts_as_closed(window: Window) -> None:
    root: Any = window._root
    root.destroy()
    assert not window.show(FRAME)
    assert window.closed


def test_closing_twice_is_closing_once(window: Window) -> None:
    window.close()
    window.close()
    assert window.closed


@pytest.mark.parametrize("frame", [np.zeros((4, 4, 3)), np.zeros((4, 4), np.uint8)])
def test_a_frame_of_another_kind_is_refused(window: Window, frame: Any) -> None:
    with pytest.raises(InputInvalid, match="expected uint8"):
        window.show(frame)


@pytest.mark.parametrize("fps", [0.0, -1.0, float("nan"), float("inf")])
def test_a_pace_that_is_none_is_refused(fps: float) -> None:
    with pytest.raises(InputInvalid, match="render_fps"):
        Window(render_fps=fps)


def test_without_tkinter_the_sentence_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "tkinter", None)
    with pytest.raises(InputInvalid, match=r"no tkinter.*rgb_array.*RecordVideo.*python3-tk"):
        Window()


def test_without_a_display_the_sentence_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_display(**_: Any) -> None:
        raise FakeTclError("no display name and no $DISPLAY environment variable")

    fake = SimpleNamespace(Tk=no_display, TclError=FakeTclError)
    monkeypatch.setitem(sys.modules, "tkinter", fake)
    with pytest.raises(InputInvalid, match=r"no display name.*rgb_array.*RecordVideo"):
        Window()


@pytest.fixture
def screen(monkeypatch: pytest.MonkeyPatch) -> Iterator[bool]:
    """Return whether tkinter can open a window, on a screen of Xvfb where that is installed."""
    if shutil.which("Xvfb") is None:
        yield window_opens()
        return
    command = ["Xvfb", "-displayfd", "1", "-screen", "0", "800x600x24", "-nolisten", "tcp"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as server:
        assert server.stdout is not None
        number = server.stdout.readline().decode().strip()  # written once it takes clients
        monkeypatch.setenv("DISPLAY", f":{number}")
        yield window_opens()
        server.terminate()


def window_opens() -> bool:
    try:
        import tkinter
    except ImportError:
        return False
    try:
        tkinter.Tk().destroy()
    except tkinter.TclError:
        return False
    return True


def test_a_real_window_shows_what_it_was_given_or_says_why_not(
    screen: bool, clock: FakeClock
) -> None:
    if not screen:
        with pytest.raises(InputInvalid, match="RecordVideo"):
            Window()
        return
    window = Window("test", render_fps=1000.0, clock=clock, sleep=clock.sleep)
    frame = np.zeros((40, 60, 3), np.uint8)
    frame[:, 30:] = (18, 104, 179)
    assert window.show(frame)
    assert window.show(np.flip(frame, 1))
    image: Any = window._image
    assert (image.width(), image.height()) == (60, 40)
    assert tuple(image.get(5, 5)) == (18, 104, 179)
    assert tuple(image.get(45, 5)) == (0, 0, 0)
    root: Any = window._root
    root.after(
        0, root.tk.eval, f"{root.protocol('WM_DELETE_WINDOW')}"
    )  # what its user's click does
    assert not window.show(frame)
    assert window.closed
