"""Foundations of all rooms: arrays, checks, compiling, threads and vectors."""
