"""ROS 2: signals as messages of ROS, in its frames and units, without a ROS installation.

`frames` turns NED and FRD into ENU and FLU, `messages` turns signals into fields of messages,
`topics` says which signals become which topic, `rows` finds them in the master's rows, `cdr` writes
messages as bytes, `topic_writer` does all of it for rows of signals. `bag` writes a recording as
rosbag2; `node` makes a running system a node, by the keys of `rmw_zenoh`: `inputs` says which topic
sets which input, `messages/readings` reads its messages, `receiver` sets the values, `services` and
`parameters` answer requests. Definitions of messages come from rosbags (extra ``ros``), those of
services from `interfaces`. Start with `topics.py`.
"""
