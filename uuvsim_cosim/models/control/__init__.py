"""Control laws and the allocation of forces to thrusters.

It may import `models.actuators`, `models.hull` and what is below them. Start reading with
`control_law.py`, then `controller.py`.
"""
