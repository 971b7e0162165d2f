"""Generation of C from a declaration, and its compilation.

It may import the modules of `fmus` itself. Start reading with `lowering.py`,
then `emit_c.py`.
"""
