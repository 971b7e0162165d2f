"""Components in processes of their own, and crash reports of foreign code.

It may import `fmus.codegen`. Start reading with `isolated.py`.
"""
