"""A vehicle's folder as a whole: files, outline, derived figures, consistency checks.

It may import every component package of `models`. Start reading with `check_vehicle_folder.py`.
"""
