"""Boxes and balls that move along a vector, against triangles: proofs by planes that separate them."""
