"""Export of a declaration, or of a whole system, as an FMU file.

It may import `fmus.codegen`. Start reading with `fmu_file.py`.
"""
