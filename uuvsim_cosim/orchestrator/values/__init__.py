"""Endpoints and values as users write them, and the conversion of a value on a connection.

It may import `fmus`, `models`. Start reading with `values.py`.
"""
