"""Acoustics around a sonar: absorption of sea water, backscatter of materials, target strength.

It may import `models.declaration`, `models.worlds`, `models.water`. Start reading with
`materials.py`.
"""
