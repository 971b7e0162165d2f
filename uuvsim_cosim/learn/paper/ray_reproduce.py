"""Reproduction of the paper's figures on a Ray cluster: each way and seed is a chain of pieces."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from uuvsim_cosim.cluster.ray_cluster import Cluster
from uuvsim_cosim.errors import UuvsimError
from uuvsim_cosim.learn.paper.reproduce import begun, keys_of, lacking, reproduce_one
from uuvsim_cosim.learn.paper.results import Key, is_kept, kept
from uuvsim_cosim.learn.paper.transfer_runs import (
    CONDITIONS,
    WAYS,
    lacking_transfers,
    run_transfer,
)
from uuvsim_cosim.learn.paper.ways import Budget, Chain, place_of
from uuvsim_cosim.learn.training.ray_training import (
    SECONDS,
    changed_files,
    clock,
    read_files,
    write_files,
)
from uuvsim_cosim.learn.training.train import one_thread

__all__ = ["reproduce_on", "transfers_on"]

RESULTS, PLACE = "results", "place"


@dataclass(frozen=True)
class _Piece:
    chain: Chain
    budget: Budget
    seed: int
    files: Mapping[str, bytes]  # of results and of the chain's folder
    seconds: float
    episodes: int
    name: str


def reproduce_on(
    cluster: Cluster,
    figure: str,
    budget: Budget,
    seeds: int,
    results: Path,
    work: Path,
    *,
    progress: Callable[[str, float, float], None] | None = None,
    seconds: float = SECONDS,
    episodes: int = 100,
) -> list[Key]:
    """Run the missing results of a figure, all ways and seeds at once; returns as `reproduce`.

    Results and checkpoints are returned to this machine after every `seconds`.
    """
    missing = lacking(results, figure, budget, seeds)
    keys = {k for c, s in missing for k in keys_of(c, budget, s) if not is_kept(results, k)}

    def piece(k: int) -> _Piece:
        chain, seed = missing[k]
        place = begun(work, budget, chain, seed)
        files = {f"{PLACE}/{name}": data for name, data in read_files(place).items()}
        for key in keys_of(chain, budget, seed):
            if (found := kept(results, key)) is not None:
                files[f"{RESULTS}/{key.stem}.json"] = found.numbers.encode()
        return _Piece(chain, budget, seed, files, seconds, episodes, str(place))

    def follow(k: int, came: tuple[Mapping[str, bytes], bool]) -> _Piece | None:
        files, done = came
        chain, seed = missing[k]
        places = {PLACE: place_of(work, budget, chain, seed), RESULTS: results}
        for name, place in places.items():
            within = {f[len(name) + 1 :]: d for f, d in files.items() if f.startswith(f"{name}/")}
            write_files(place, within)
        return None if done else piece(k)

    ended = 0
    for _, (_, done) in cluster.spread(_advance, map(piece, range(len(missing))), follow):
        ended += done
        if progress is not None:
            progress("training", ended, len(missing))
    return sorted(k for k in keys if is_kept(results, k))


def transfers_on(
    cluster: Cluster,
    seeds: int,
    results: Path,
    *,
    progress: Callable[[str, float, float], None] | None = None,
    ways: tuple[str, ...] = tuple(WAYS),
    conditions: tuple[str, ...] = tuple(CONDITIONS),
    episodes: int = 100,
) -> list[str]:
    """Run the missing results of figure 11, as `run_transfers`; each way and seed is one piece."""
    missing = lacking_transfers(seeds, results, ways)
    pieces = [(name, seed, conditions, episodes) for name, seed in missing]
    ran = []
    for k, files in cluster.spread(_transferred, pieces):
        write_files(results, files)
        ran.append("{}-{}".format(*missing[k]))
        if progress is not None:
            progress("training", len(ran), len(missing))
    return sorted(ran)


def _transferred(piece: tuple[str, int, tuple[str, ...], int]) -> Mapping[str, bytes]:
    name, seed, conditions, episodes = piece
    with tempfile.TemporaryDirectory(prefix="uuvsim-") as temporary, one_thread():
        places = Path(temporary) / RESULTS, Path(temporary) / PLACE
        file = run_transfer(name, seed, *places, conditions=conditions, episodes=episodes)
        return {file.name: file.read_bytes()}


def _advance(piece: _Piece) -> tuple[Mapping[str, bytes], bool]:
    """Run one piece of a chain, in a worker; returns changed files, and whether it is finished."""
    with tempfile.TemporaryDirectory(prefix="uuvsim-") as temporary, one_thread():
        root = Path(temporary)
        write_files(root, piece.files)
        done = True
        try:
            reproduce_one(
                piece.chain, piece.budget, piece.seed, root / RESULTS, root / PLACE,
                interrupted=clock(piece.seconds), episodes=piece.episodes,
            )  # fmt: skip
        except KeyboardInterrupt:
            done = False
        except UuvsimError as error:
            raise UuvsimError(str(error).replace(str(root / PLACE), piece.name)) from None
        return changed_files(root, piece.files), done
