"""ROS 2: signals as messages of ROS, in its frames and units, without a ROS installation.

`frames` turns NED and FRD into ENU and FLU, `conversions` turns signals into fields of messages,
`topics` says which signals become which topic, `rows` finds them in the master's rows, `cdr` writes
messages as bytes, `topic_writer` does all of it for rows of signals. `bag` writes a recording as
rosbag2; `node` publishes a running system, by the keys of `rmw_zenoh`. Definitions of messages come
from rosbags (extra ``ros``). Start with `topics.py`.
"""
