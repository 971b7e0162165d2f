"""Sea water, currents and waves.

It may import `models.declaration`, `models.intrinsics`. Start reading with `seawater.py`,
`current.py`.
"""
