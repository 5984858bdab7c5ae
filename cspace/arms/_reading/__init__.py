"""Readers of URDF and SRDF, of files of spheres, and of MoveIt's messages.

They take files, texts, messages and mappings, and give shapes with poses, and records of links,
joints and other plain values. They know neither arms nor proofs.
"""
