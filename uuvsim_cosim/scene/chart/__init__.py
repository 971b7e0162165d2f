"""Nautical charts (S-57): files, records, codes, projection.

It may import `scene.shared`. Start reading with `read.py`.
"""
