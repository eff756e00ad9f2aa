"""The world as environments of Gymnasium (one mission or many), PettingZoo, TorchRL and Stable-Baselines3.

Public: the modules' environment classes.
"""
