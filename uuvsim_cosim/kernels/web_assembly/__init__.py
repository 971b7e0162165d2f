"""A system of declarations in WebAssembly, and the hash of its outputs.

It may import all of `kernels`. Start reading with `module.py`.
"""
