"""Environments of one kernel: their memory, threads and variables.

It may import `kernels.codegen`. Start reading with `batch.py`.
"""
