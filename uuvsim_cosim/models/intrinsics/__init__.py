"""Functions that equations call as one: tables, fields, networks, optimisers.

It may import nothing else of `models`. Start reading with `table.py`.
"""
