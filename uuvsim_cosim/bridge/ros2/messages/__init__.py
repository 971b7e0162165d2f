"""Types of ROS messages: how signals become their fields, and how their fields become signals.

`conversion` is the shape of a conversion; `conversions` has all of them, with those of rays and of
states in files of their own. `readings` is the inverse, for recorded topics.
"""
