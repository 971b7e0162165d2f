"""Many components become one simulation.

The stepping loop in C and the shipped systems lie in the folder ``orchestrator/`` at the top.
"""
