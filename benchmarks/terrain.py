"""A chart or grid to terrain: CPU seconds, errors at soundings left out, share within its band.

    python benchmarks/terrain.py CELL.000 [more charts, BAG, GeoTIFF] [--resolution 10]

Beside it, in the same run: the same triangulation by scipy's LinearNDInterpolator alone.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np

from uuvsim_cosim.scene.terrain.make import TerrainOptions, make_terrain


def main() -> None:
    said = argparse.ArgumentParser(description=__doc__)
    said.add_argument("charts", nargs="+", type=Path)
    said.add_argument("--resolution", type=float, default=10.0)
    said.add_argument("--scipy", action="store_true", help="time scipy's interpolator as well")
    options = said.parse_args()
    wishes = TerrainOptions(resolution=options.resolution)
    make_terrain(options.charts[0], TerrainOptions(resolution=20 * options.resolution))  # imports
    head = ("chart", "nodes", "CPU [s]", "ns a node", "left out: median [m]", "mean [m]", "in band")
    print(" | ".join(head))
    for chart in options.charts:
        start = time.process_time()
        made = make_terrain(chart, wishes)
        spent = time.process_time() - start
        nodes = made.terrain.z.size
        median = made.hold_out.median if made.hold_out else float("nan")
        mean = made.hold_out.mean if made.hold_out else float("nan")
        print(
            f"{chart.name} | {nodes:,} | {spent:.2f} | {1e9 * spent / nodes:.0f} | {median:.2f} | "
            f"{mean:.2f} | {100 * made.in_band:.1f} %"
        )
        if options.scipy and chart.suffix == ".000":
            print(
                f"  scipy's interpolator on the same points alone: {_scipy(chart, options):.2f} s"
            )


def _scipy(chart: Path, options: Any) -> float:
    from scipy.interpolate import LinearNDInterpolator

    from uuvsim_cosim.scene.chart.read import read_chart
    from uuvsim_cosim.scene.terrain.grid import grid_over
    from uuvsim_cosim.scene.terrain.points import known_points

    read = read_chart(chart)
    points = known_points(read, options.resolution)
    corners = points.xy.min(axis=0), points.xy.max(axis=0)
    grid = grid_over((*map(float, corners[0]), *map(float, corners[1])), options.resolution)
    nodes = np.stack(np.meshgrid(grid.east, grid.north), -1)
    start = time.process_time()
    LinearNDInterpolator(points.xy, points.z)(nodes)
    return time.process_time() - start


if __name__ == "__main__":
    main()
