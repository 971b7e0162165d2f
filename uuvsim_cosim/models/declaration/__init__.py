"""The declaration of a component: variables with units, equations, parameter files.

It may import nothing else of `models`. Start reading with `model.py`, then `library.py`.
"""
