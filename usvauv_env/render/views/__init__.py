"""Views of a mission: the map with its axes (`map`), the perspective (`perspective`) of a scene with its camera
(`scene`), that from beside a boat (`boat_view`), and pictures of the sea (`sea_surface`).
"""
