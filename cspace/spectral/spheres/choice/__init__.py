"""The choice of balls: by a number or a tolerance, of different radii or of one."""
