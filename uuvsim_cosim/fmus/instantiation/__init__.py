"""An FMU file as a running component: FMI version, interface type and process chosen.

It may import `fmus.model_exchange`, `fmus.importer`, `fmus.isolation`. Start reading with
`instantiate.py`.
"""
