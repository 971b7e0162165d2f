"""MAVLink: a simulated vehicle that speaks like ArduSub, and a component that follows a vehicle.

`link.py` holds addresses and bytes, `vehicle.py` the state as messages, `services.py` the requests,
`missions.py` the mission protocol, `dataflash.py` the log, `server.py` the thread. The codec is
pymavlink's (extra `mavlink`), imported inside functions only. Start with `server.py`.
"""
