"""Canary: hashes of elementary functions and linear algebra on this machine.

Generated components contain no function of the C library, but constants of the declarations are
computed by Python, NumPy and SciPy, and a training is computed by PyTorch. Where the canary differs
from the recorded one, recorded values cannot be expected to the last bit. The tests then compare
only the parts that do not depend on it, and report that they did.
"""

from __future__ import annotations

import hashlib
import math
import platform
from collections.abc import Mapping
from importlib.metadata import version
from typing import Any

import numpy as np

from tests.freeze.moved import definition

TABLE = [k / 16 for k in range(1, 400)]
FUNCTIONS = ("sin", "cos", "tan", "exp", "log", "atan", "sinh", "tanh", "sqrt", "cbrt")


def hash_of(data: bytes) -> str:
    """Return the first 16 digits of SHA-256."""
    return hashlib.sha256(data).hexdigest()[:16]


def canary() -> dict[str, Any]:
    """Return hashes that decide whether values are comparable, and what explains a difference."""
    library = [getattr(math, f)(x) for f in FUNCTIONS for x in TABLE]
    library += [math.pow(x, 1.7) for x in TABLE] + [math.atan2(x, 3.0) for x in TABLE]
    table = np.array(TABLE)
    arrays = [np.sin(table), np.cos(table), np.exp(-table), np.tanh(table), np.power(table, 1.7)]
    random = np.random.default_rng(1)
    square, wide = random.normal(size=(24, 24)), random.normal(size=(6, 8))
    algebra = [square @ square, np.linalg.inv(square), np.linalg.pinv(wide)]
    algebra.append(np.linalg.svd(square)[1])
    return {
        "decides": {
            "C library": hash_of(np.array(library).tobytes()),
            "NumPy": hash_of(np.concatenate(arrays).tobytes()),
            "linear algebra": hash_of(b"".join(a.tobytes() for a in algebra)),
            "CasADi": version("casadi"),
        },
        "about": {
            "machine": platform.machine(),
            "C library": " ".join(platform.libc_ver()),
            "NumPy": np.__version__,
            "SciPy": version("scipy"),
            "compiler": definition("compiler", "fmus")()[1],
        },
    }


def training_canary() -> dict[str, str]:
    """Return the version of PyTorch and a hash of operations that a training uses."""
    import torch

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        generator = torch.Generator().manual_seed(1)
        x = torch.randn(32, 24, generator=generator)
        w = torch.randn(24, 16, generator=generator, requires_grad=True)
        y = torch.nn.functional.softplus(torch.relu(x @ w)).tanh().log1p().sum()
        y.backward()
        numbers = w.grad.numpy().tobytes() + y.detach().numpy().tobytes()
        # Processors differ in the products of some shapes only: those of a policy's layers.
        for rows in (1, 4, 8, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512):
            for inputs, outputs in ((31, 16), (16, 16), (16, 2), (16, 1), (31, 31)):
                a = torch.randn(rows, inputs, generator=generator)
                b = torch.randn(outputs, inputs, generator=generator)
                product = torch.nn.functional.linear(a, b)
                for result in (product, product.T @ a, product @ b, product.sum(0)):
                    numbers += result.numpy().tobytes()
    finally:
        torch.set_num_threads(threads)
    return {"PyTorch": torch.__version__, "operations": hash_of(numbers)}


def unlike(recorded: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """Return what of this machine differs from the recorded canary, in words."""
    return [
        f"{name} ({recorded[name]} recorded, {now.get(name)} here)"
        for name in recorded
        if recorded[name] != now.get(name)
    ]
