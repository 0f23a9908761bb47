"""Choice of the sources that one of 1 000 ranks sends to the others: processor time.

    python benchmarks/entries_of_ranks.py

The ranks hold squares of a lattice, or cubes, each divided into 16 boxes.  One in the middle has
350 000 sources.  The first row has ranks that are all out of reach.
"""

import argparse
import time

import numpy as np

from adaptsize.limiting.exact.exchange import entries_in_reach
from adaptsize.limiting.exact.field import node_entries

G, LARGEST = 0.3, 1.0
PIECES = {2: (4, 4), 3: (4, 2, 2)}


def boxes_of(rank):
    """Return the boxes of the rank whose part has the side 1 and this lower corner."""
    pieces = np.array(PIECES[len(rank)])
    lower = np.stack(np.meshgrid(*map(np.arange, pieces), indexing="ij"), -1) / pieces
    lower = lower.reshape(-1, len(rank)) + rank
    return np.column_stack([lower, lower + 1.0 / pieces, np.full(len(lower), LARGEST)])


def sources(dim, n, reach, rng):
    """Return sources in the part at 0, which act up to distances from 0 to ``reach``."""
    points = rng.random((n, dim))
    bounds = LARGEST - G * reach * (np.sin(9.0 * points[:, 0]) * np.cos(7.0 * points[:, 1])) ** 2
    return node_entries(points, bounds, np.arange(n, dtype=np.int32))


def choose(entries, ranks):
    """Return the number of entries for all ranks."""
    return sum(len(entries_in_reach(entries, boxes, G)) for boxes in ranks)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--sources", type=int, default=350_000)
    n = parser.parse_args().sources
    rng = np.random.default_rng(1)
    for dim, side in ((2, 32), (3, 10)):
        lattice = np.stack(np.meshgrid(*[np.arange(side) - side // 2] * dim), -1).reshape(-1, dim)
        ranks = [boxes_of(rank.astype(float)) for rank in lattice if rank.any()]
        far = [boxes_of(rank + 100.0) for rank in lattice if rank.any()]
        for others, reach in ((far, 1.0), (ranks, 1.0), (ranks, 2.0), (ranks, 4.0)):
            entries = sources(dim, n, reach, rng)
            choose(entries, others[:1])
            start = time.process_time()
            sent = choose(entries, others)
            spent = time.process_time() - start
            print(
                f"{dim} axes, {len(others)} other ranks, reach {reach}: "
                f"{sent / n:.2f} entries sent per source, {spent:.4f} s"
            )


if __name__ == "__main__":
    main()
