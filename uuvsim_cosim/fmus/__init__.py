"""A declaration becomes a file, a file becomes a component.

The C around it (runtime, FMI functions) lies in the folder ``fmus/`` at the top.
"""
