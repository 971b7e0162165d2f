"""Autopilots as components: the real ArduSub or PX4 binary in lockstep with the simulation."""
