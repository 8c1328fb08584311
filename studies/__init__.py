"""Long computations run by hand: coverage, benchmark, rebuilding data/derived."""

import os


def seed(usual: int) -> int:
    """Give the seed of a study, or the one that `make findings` sets to try another."""
    return int(os.environ.get("COMPENDIUM_SEED") or usual)
