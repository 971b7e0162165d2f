"""Sensors: IMU, DVL, pressure, compass, USBL, GPS, sonar, and their errors.

It may import `models.hull`, `models.worlds` and what is below them. Start reading with `imu.py`,
then `sensor_error.py`.
"""
