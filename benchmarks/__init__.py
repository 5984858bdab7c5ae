"""Benchmarks: peers and ours in one process, taken in turns; ``python -m benchmarks --help`` lists them."""
