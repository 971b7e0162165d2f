"""Derivatives through a kernel: tangents, adjoints, torch.

It may import `kernels.batch`, `kernels.codegen`. Start reading with `rollout.py`.
"""
