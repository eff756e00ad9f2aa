"""The AUVs of a mission: `motion` of points, `vehicles` with dynamics and the water there, and dead `reckoning`."""
