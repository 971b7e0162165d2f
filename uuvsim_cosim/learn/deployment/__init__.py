"""Export of policies: FMU, ONNX, PyTorch tensors, a NumPy runner, or a component.

It may import `learn.data`, `learn.training` and lower parts. Start reading with `export.py`.
"""
