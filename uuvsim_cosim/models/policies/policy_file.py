"""A trained policy's file (.npz of arrays and one JSON text) as a declaration needs it.

The file is that of `learn/policies/policy.py`, which trainings write; here it is only read.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.files_read import noted

__all__ = ["Channel", "PolicyFile", "read_policy"]

FORMAT = 1


@dataclass(frozen=True)
class Channel:
    """One number of an observation or of an action, with its limits in its unit."""

    name: str
    low: float
    high: float
    unit: str


@dataclass(frozen=True)
class PolicyFile:
    """Tensors, and what they observe and act on; see `learn.policy.Policy`."""

    path: Path
    kind: str
    tensors: Mapping[str, NDArray[np.float32]]
    observation: tuple[Channel, ...]
    action: tuple[Channel, ...]
    task: str
    options: Mapping[str, Any]
    activation: str
    settings: Mapping[str, Any]


def read_policy(path: Path) -> PolicyFile:
    """Read a policy; raises InputInvalid for a file that is none, or of a later format."""
    if not path.is_file():
        raise InputInvalid(path, "no such file", "a policy (.npz)")
    try:
        with np.load(BytesIO(noted(path).read_bytes()), allow_pickle=False) as read:
            tensors = {name: np.asarray(read[name]) for name in read.files}
        head = json.loads(bytes(tensors.pop("head")))
        if head["uuvsim_policy"] != FORMAT:
            raise InputInvalid(path, f"format {head['uuvsim_policy']}", FORMAT)
        for name, tensor in tensors.items():
            if tensor.dtype != np.float32 or not np.all(np.isfinite(tensor)):
                raise ValueError(f"tensor {name!r} is not of finite float32")
        return PolicyFile(
            path=path,
            kind=head["kind"],
            tensors=tensors,
            observation=tuple(Channel(**c) for c in head["observation"]),
            action=tuple(Channel(**c) for c in head["action"]),
            task=head["task"],
            options=head["options"],
            activation=head["activation"],
            settings=head["settings"],
        )
    except (ValueError, KeyError, TypeError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise InputInvalid(
            path, f"{type(error).__name__}: {error}", "a whole policy as `uuvsim train` writes it"
        ) from None
