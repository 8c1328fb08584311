"""Long computations run by hand: coverage, benchmark, rebuilding data/derived."""
