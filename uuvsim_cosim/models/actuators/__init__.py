"""Thrusters, propellers, fins, batteries, and their faults.

It may import `models.hull` and what is below it. Start reading with `thruster.py`.
"""
