"""Import of an FMU file as a live component: archive, description, library, values.

It may import `fmus.isolation`, `fmus.codegen`. Start reading with `read_description.py`, then
`fmu3.py`.
"""
