"""A system of declarations as one self-contained FMU.

It may import `kernels.codegen`. Start reading with `system_fmu.py`.
"""
