"""The record of a map: its arrays, the exterior, updates, and the saved folder."""
