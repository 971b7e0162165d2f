"""Build a system: two thrusters on one battery, one of them a nested system of its own."""

from pathlib import Path

import uuvsim_cosim as uuv
from uuvsim_cosim.orchestrator import write_ssd

pod = (
    uuv.System("pod", "0.01", "A thruster in a housing")
    .add("motor", "model:thruster_t200", start={"u": 0.5})
    .expose("voltage", "motor.voltage")
    .expose("current", "motor.current")
    .expose("thrust", "motor.thrust")
)
system = (
    uuv.System("bench", "0.01", "Two thrusters drain one battery")
    .add("battery", "model:battery", start={"soc_0": 0.3})
    .add("meter", "model:wrench")
    .add("port", pod)
    .add("starboard", pod)
    .connect("battery.voltage", "port.voltage")
    .connect("battery.voltage", "starboard.voltage")
    .connect("port.current", "meter.current[1]")
    .connect("starboard.current", "meter.current[2]")
    .connect("meter.current_total", "battery.current")
    .set("starboard.motor.u", -0.5)
)
write_ssd(system, Path("bench.ssd"))
assert uuv.load("bench.ssd") == system

signals = uuv.run(system, until=5.0, out="bench_run").signals()
for side in ("port", "starboard"):
    print(f"{side:9} {signals[f'{side}.motor.thrust'][-1]:6.2f} N")
print(f"battery   {signals['battery.voltage'][-1]:6.2f} V")
