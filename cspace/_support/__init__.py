"""Foundations of all packages: arrays, checks, compiling, threads and vectors."""
