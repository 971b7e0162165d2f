"""Geometry: closed surfaces, their volumes, and bounding-box trees over them.

It may import `models.declaration`. Start reading with `mesh.py`.
"""
