"""Import of a URDF, SDF, xacro or surface as a vehicle.

It may import `models.vehicles` and what is below it. Start reading with `new_vehicle.py`,
`import_description.py`, `import_mesh.py`.
"""
