"""Types of expressions: equations are written in CasADi's SX, and may hold plain numbers."""

from __future__ import annotations

from typing import TypeAlias

import casadi as ca

__all__ = ["Number"]

# An expression, or a number that stands for one. An argument that is indexed, or whose attributes
# are read, is an expression: `ca.SX`.
Number: TypeAlias = ca.SX | float
