"""Autopilots as components: the real ArduSub binary in lockstep with the simulation."""
