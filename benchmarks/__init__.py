"""Benchmarks of this library and its peers; ``python -m benchmarks --help`` lists them."""
