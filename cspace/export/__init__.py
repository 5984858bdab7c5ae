"""Maps for other software, one theme per module."""
