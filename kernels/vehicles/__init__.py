"""Vehicles with dynamics: rigid bodies in water with actuators, controllers and limits, LANES at a time."""
