"""FMUs in WebAssembly, run by wasmtime without files, network and processes.

It may import `fmus.model_exchange` and below. Start reading with `sandbox.py`.
"""
