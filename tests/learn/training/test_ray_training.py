"""Trainings on a cluster: what is refused before a worker is asked."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.training.config import TrainingConfig
from uuvsim_cosim.learn.training.folders import TRAINING, write_owner
from uuvsim_cosim.learn.training.ray_training import train_on
from uuvsim_cosim.learn.training.train import resolved


def test_a_folder_of_another_training_is_refused_and_stays_as_it_is(tmp_path: Path) -> None:
    first = TrainingConfig("source", algorithm="sac", steps=10)
    write_owner(tmp_path, resolved(first), restart=False)
    before = json.loads((tmp_path / TRAINING).read_text())
    nobody: Any = None  # no worker is asked
    with pytest.raises(InputInvalid, match="holds a training with seed 0; expected 1, another"):
        train_on(nobody, [first.changed(seed=1)], [tmp_path])
    assert json.loads((tmp_path / TRAINING).read_text()) == before
