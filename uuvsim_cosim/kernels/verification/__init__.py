"""Verification that a system has the same bits in every way in which it can run.

It may import all of `kernels`. Start reading with `verify.py`.
"""
