"""Checkpoint: the whole state of a training in one file, so that it resumes with the same bits."""

from __future__ import annotations

import io
import pickle
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch

from uuvsim_cosim.cache import write_whole
from uuvsim_cosim.errors import InputInvalid, RecordingError

__all__ = [
    "State", "load_checkpoint", "philox_state", "save_checkpoint", "set_philox_state", "unfit",
]  # fmt: skip

State = Mapping[str, Any]  # tensors, arrays, numbers and texts, nested in mappings and lists
FORMAT = 2  # 1: without averaged actors


def save_checkpoint(path: Path, content: State) -> None:
    """Write a state, whole or not at all; raises RecordingError if it cannot be written."""
    buffer = io.BytesIO()
    torch.save({"uuvsim_checkpoint": FORMAT, "content": _tensors(content)}, buffer)
    try:
        write_whole(path, buffer.getvalue())
    except OSError as error:
        raise RecordingError(
            path,
            f"{error.strerror}; the previous checkpoint is kept",
            f"{len(buffer.getvalue())} free bytes in a folder that can be written",
        ) from error


def load_checkpoint(path: Path) -> dict[str, Any]:
    """Read a file of `save_checkpoint`, without running code from it.

    Raises InputInvalid for a file that is missing, damaged, or of another program or version.
    """
    if not path.is_file():
        raise InputInvalid(path, "no such file", "a checkpoint (.pt)")
    wanted = "expected a whole checkpoint as `uuvsim train` writes it"
    try:
        with zipfile.ZipFile(path) as parts:  # torch does not look at checksums
            damaged = parts.testzip()
        if damaged is not None:
            raise InputInvalid(f"{path}: {damaged} in it is damaged; {wanted}")
        read = torch.load(path, map_location="cpu", weights_only=True)
    except (RuntimeError, pickle.UnpicklingError, zipfile.BadZipFile, zlib.error, EOFError,
            NotImplementedError, ValueError, KeyError, AttributeError):  # fmt: skip
        raise InputInvalid(f"{path}: damaged, or of another program; {wanted}") from None
    except OSError as error:
        raise InputInvalid(f"{path}: {error.strerror or error}; {wanted}") from None
    if not isinstance(read, dict) or "uuvsim_checkpoint" not in read:
        raise InputInvalid(f"{path}: {type(read).__name__} of another program; {wanted}")
    if read["uuvsim_checkpoint"] != FORMAT:
        raise InputInvalid(
            path,
            f"format {read['uuvsim_checkpoint']}, written by another version of this package",
            f"{FORMAT}, or a new start (--restart)",
        )
    return dict(_arrays(read["content"]))


def unfit(error: Exception) -> InputInvalid:
    """Return the error of a checkpoint that does not fit a learner."""
    if isinstance(error, KeyError):
        reason = f"{error} is not in it"
    else:  # torch lists on further lines every number that differs
        reason = str(error).splitlines()[0].rstrip(": ") if str(error) else type(error).__name__
    return InputInvalid(reason, "one of this algorithm, with networks of these widths")


def philox_state(random: np.random.Generator) -> dict[str, list[int]]:
    """Return the state of a Philox generator as plain integers."""
    state = random.bit_generator.state
    inner = state["state"]
    return {
        "counter": [int(x) for x in inner["counter"]],
        "key": [int(x) for x in inner["key"]],
        "buffer": [int(x) for x in state["buffer"]],
        "rest": [int(state[k]) for k in ("buffer_pos", "has_uint32", "uinteger")],
    }


def set_philox_state(random: np.random.Generator, kept: Mapping[str, list[int]]) -> None:
    """Restore the state of a Philox generator."""
    pos, has, word = kept["rest"]
    random.bit_generator.state = {
        "bit_generator": "Philox",
        "state": {
            "counter": np.array(kept["counter"], np.uint64),
            "key": np.array(kept["key"], np.uint64),
        },
        "buffer": np.array(kept["buffer"], np.uint64),
        "buffer_pos": pos,
        "has_uint32": has,
        "uinteger": word,
    }


def _tensors(value: object) -> object:
    """Replace arrays by marked tensors, since torch.load accepts no arrays."""
    if isinstance(value, np.ndarray):
        kept = value.view(np.int64) if value.dtype == np.uint64 else value
        return {"__array__": str(value.dtype), "data": torch.from_numpy(np.ascontiguousarray(kept))}
    if isinstance(value, Mapping):
        return {k: _tensors(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_tensors(v) for v in value]
    return value.item() if isinstance(value, np.generic) else value


def _arrays(value: Any) -> Any:
    if isinstance(value, dict):
        if "__array__" in value:
            return value["data"].numpy().astype(value["__array__"], copy=False)
        return {k: _arrays(v) for k, v in value.items()}
    return [_arrays(v) for v in value] if isinstance(value, list) else value
