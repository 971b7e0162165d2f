"""MAVLink: a simulated vehicle that speaks like ArduSub, and a component that follows a vehicle.

`link.py` holds addresses and sockets, `codec.py` messages as bytes and their signatures,
`vehicle.py` the state as messages, `services.py` the requests, `missions.py` the mission protocol,
`dataflash.py` the log, `server.py` the thread, `follower.py` the component. pymavlink (extra
`mavlink`) is imported inside functions only. Start with `server.py`.
"""
