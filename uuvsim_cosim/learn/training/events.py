"""Curves of a running training for TensorBoard."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, final

from uuvsim_cosim.closing import Closing

if TYPE_CHECKING:
    from torch.utils.tensorboard import SummaryWriter

    from uuvsim_cosim.learn.training.training import Progress

__all__ = ["Events"]

POINTS = 1000  # of the losses, over the whole training


@final
class Events(Closing):
    """A TrainingObserver that writes event files into a folder.

    Scalars are loss/…, episodes/… (means of those that ended in one step) and evaluation/…, over
    environment steps. A resumed training removes the points after its checkpoint.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._writer: SummaryWriter | None = None
        self._last = -1

    @staticmethod
    def possible() -> bool:
        """Return whether TensorBoard is installed."""
        from importlib.util import find_spec

        return find_spec("tensorboard") is not None

    def close(self) -> None:
        """Flush and close the event file."""
        if self._writer is not None:
            self._writer.close()

    def __call__(self, progress: Progress) -> None:
        """Write the numbers of the progress."""
        if self._writer is None:
            from torch.utils.tensorboard import SummaryWriter

            self._writer = SummaryWriter(str(self._folder), purge_step=progress.step)
        if progress.what == "step":
            share = progress.step * POINTS // max(progress.steps, 1)
            if share == self._last or not progress.row:
                return
            self._last = share
        family = "loss" if progress.what == "step" else progress.what
        for name, value in progress.row.items():
            if name not in ("step", "stopped"):
                self._writer.add_scalar(f"{family}/{name}", value, progress.step)
        if progress.what == "checkpoint":
            self._writer.flush()
