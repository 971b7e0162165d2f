"""Learn the commands of eight thrusters by gradients through a kernel; needs torch (extra rl)."""

import torch

import uuvsim_cosim as uuv
from uuvsim_cosim.kernels import rollout

system = uuv.System("free", "0.01").add("hull", "model:bluerov2_heavy")
system = system.add("wrench", "model:wrench").connect("wrench.tau", "hull.tau")
for i in range(1, 9):
    system = (
        system.add(f"thruster_{i}", "model:thruster")
        .connect("hull.nu_r", f"thruster_{i}.nu_r")
        .connect(f"thruster_{i}.thrust", f"wrench.thrust[{i}]")
    )
kernel = uuv.fuse(system)

start = {"hull.eta_0": torch.tensor([0.0, 0.0, 5.0, 0.0, 0.0, 0.0])}
goal = torch.tensor([0.1, 0.0, 5.02, 0.0, 0.0, 0.2])  # a second later
u = torch.full((8, 100, 1), 0.1, requires_grad=True)  # thruster, step, environment
optimizer = torch.optim.Adam([u], lr=0.02)
for iteration in range(20):
    commands = {f"thruster_{i}.u": u[i - 1].clamp(-1, 1) for i in range(1, 9)}
    seen = rollout(kernel, start, ["hull.eta"], steps=100, inputs=commands)
    error = ((seen["hull.eta"][-1] - goal) ** 2).sum()  # m2 + rad2
    optimizer.zero_grad()
    error.backward()
    optimizer.step()
    if iteration % 5 == 0:
        print(f"{iteration:3d}  {error.item():.5f}")
