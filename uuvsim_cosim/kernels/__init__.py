"""A plan becomes one function: a system of declarations compiled over lanes of environments.

The C around what is generated lies in the folder ``fmus/kernels/`` at the top.
"""

from uuvsim_cosim.kernels.batch import Batch
from uuvsim_cosim.kernels.kernel import Kernel, fuse

__all__ = ["Batch", "Kernel", "fuse"]
