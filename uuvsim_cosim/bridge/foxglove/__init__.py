"""Foxglove: a running system over the WebSocket protocol of Foxglove, subprotocol foxglove.sdk.v1.

`channels` turns signals into messages, in the frames of ROS (ENU, FLU); `georeference` finds the
place on Earth; `requests` turns parameters, services and published inputs into calls of the table;
`permissions` decides what clients may do; `server` connects all of it to foxglove-sdk (extra
``foxglove``). The scene is drawn by `view.scene3d`, which is handed in. Start with `server.py`.
"""
