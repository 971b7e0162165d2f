"""A policy leaves: as an FMU, ONNX, torch tensors, a numpy runner, or a component.

It may import `learn.data`, `learn.training` and lower parts. Start reading with `export.py`.
"""
