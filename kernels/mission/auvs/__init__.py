"""The AUVs of a mission: `motion` of points, dead reckoning of all; `vehicles` with dynamics, and the water there."""
