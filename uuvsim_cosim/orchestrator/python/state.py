"""States of Python components as bytes; deserializing them cannot run code."""

from __future__ import annotations

import io
import pickle
from typing import Any

from uuvsim_cosim.errors import FmuError

__all__ = ["pickled", "unpickled"]

# Classes and functions that pickles of numpy arrays, generators and standard containers name.
_ALLOWED = {
    "builtins": {"set", "frozenset", "complex", "bytearray", "range", "slice"},
    "collections": {"deque", "OrderedDict", "defaultdict", "Counter"},
    "fractions": {"Fraction"},
    "numpy": {"ndarray", "dtype"},
    "numpy._core.multiarray": {"_reconstruct", "scalar"},
    "numpy.core.multiarray": {"_reconstruct", "scalar"},
    "numpy._core.numeric": {"_frombuffer"},
    "numpy.core.numeric": {"_frombuffer"},
    "numpy.random._pickle": {"__generator_ctor", "__bit_generator_ctor"},
    "numpy.random._pcg64": {"PCG64"},
    "numpy.random._philox": {"Philox"},
    "numpy.random.bit_generator": {"SeedSequence", "__pyx_unpickle_SeedSequence"},
}


class _Reader(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        if name not in _ALLOWED.get(module, ()):
            raise pickle.UnpicklingError(f"{module}.{name}")
        return super().find_class(module, name)


def pickled(state: object, path: str) -> bytes:
    """Turn a state into bytes; raises FmuError unless `unpickled` can read it back."""
    try:
        data = pickle.dumps(state, protocol=4)
    except Exception as error:
        raise FmuError(f"{path}: its state cannot be written ({error})") from error
    unpickled(data, path)
    return data


def unpickled(data: bytes, path: str) -> Any:
    """Turn bytes into a state; raises FmuError for anything but numbers, texts and containers."""
    try:
        return _Reader(io.BytesIO(data)).load()
    except Exception as error:
        raise FmuError(
            path,
            f"its state holds {error}",
            "numbers, text, arrays and containers of them, which alone can be kept in a file",
        ) from error
