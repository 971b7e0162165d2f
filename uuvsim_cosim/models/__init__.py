"""What one component is: declarations in CasADi, in Fossen's notation.

The numbers (vehicles, thrusters, instruments, gains) lie in the folder ``models/`` at the top.
"""
