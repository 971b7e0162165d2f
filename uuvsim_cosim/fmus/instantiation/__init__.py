"""Instantiation of an FMU file: choice of the FMI version, interface type and process.

It may import `fmus.model_exchange`, `fmus.importer`, `fmus.isolation`. Start reading with
`instantiate.py`.
"""
