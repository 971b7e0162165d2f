"""Components in separate processes, and crash reports of foreign code.

It may import `fmus.codegen`. Start reading with `isolated.py`.
"""
